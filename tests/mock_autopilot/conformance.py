"""The table of recorded facts: `python -m tests.mock_autopilot.conformance` writes docs/px4-conformance.md."""

import sys
from pathlib import Path

from tests.mock_autopilot.fact import Fact, Value
from tests.mock_autopilot.facts import arming, dynamics, flights, link, offboard, vision
from tests.mock_autopilot.reenact.known import compared
from tests.mock_autopilot.reenact.page import section

DOCUMENT = Path(__file__).parents[2] / "docs" / "px4-conformance.md"
FACTS: tuple[Fact, ...] = (
    *link.FACTS,
    *arming.FACTS,
    *offboard.FACTS,
    *vision.FACTS,
    *dynamics.FACTS,
    *flights.FACTS,
    *flights.BY_SOURCE,
)
SECTIONS = {
    "streams": "Streams and the first seconds",
    "texts": "STATUSTEXT",
    "a": "a. Arming",
    "b": "b. Modes and OFFBOARD without a stream",
    "c": "c. Setpoint loss",
    "d": "d. Bad setpoints",
    "e": "e. Disarm, kill, take-off detection",
    "f": "f. Parameters",
    "g": "g. Take-off and landing",
    "h": "h. Vision without GPS",
    "i": "i. Two ground stations",
    "j": "j. Requests",
    "k": "k. After offboard.stop()",
    "l": "l. Dynamics",
    "m": "m. Whole flights with motion capture and a joystick",
    "n": "n. From PX4's source",
}
RECORDINGS = {
    "streams": "passive_boot, nominal_mavsdk4",
    "texts": "edge_ground",
    "a": "edge_ground",
    "b": "edge_ground, edge_air",
    "c": "loss_obl3 to loss_obl7, edge_air",
    "d": "edge_air",
    "e": "edge_air",
    "f": "edge_ground",
    "g": "edge_air, nominal_mavsdk4",
    "h": "vision_raw, vision_mavsdk4, vision_origin_mavsdk4",
    "i": "two_gcs",
    "j": "edge_ground",
    "k": "nominal_mavsdk4",
    "l": "step_response",
}
"""Source of a section, where a fact names none of its own."""
HEADINGS = "| id | fact | PX4 v1.17 | mock | accepted | recording |"
RULE = "| --- | --- | --- | --- | --- | --- |"
HEAD = """# How the mock autopilot compares with PX4

Written by `make conformance`; do not edit. {count} facts recorded from PX4 v1.17.0 SITL (SIH quadrotor, stock
parameters unless the line says otherwise; the recordings of sections a to l ran 2-3 % slower than their own clock), and
what `mock_autopilot` does, measured in simulated time. {source_count} more, in section n, are read from PX4's source.
A state is `base_mode, main/sub mode, system_status` as in HEARTBEAT.
`tests/mock_autopilot/test_conformance.py` fails when a value leaves its range or this page is out of date.

## Known differences

- The estimator is a stand-in: fixed gains instead of a Kalman filter. Its errors are those recorded in flights with
  motion capture (`[estimator]` of the mock's file, on unless `attitude_error_rad = 0`): roll and pitch off by a random
  walk of 1.2 degrees and 5 s, or as in one of three recorded flights; what follows from it for position and velocity,
  with gains as EKF2_EVP_NOISE has them; a height 0.1 to 0.7 m too high with a distance sensor and EKF2_RNG_CTRL = 1.
  `tests/mock_autopilot/px4/test_attitude_error.py` and `test_horizon.py` hold them against the recorded numbers. The
  facts below are measured without them: no chance decides about a mode or a text.
- EKF2_EVA_NOISE and EKF2_EVV_NOISE change nothing: the heading is right, and velocities are rarely sent.
- Without these errors and without vision the estimate drifts as in the worst of three recorded losses of a vehicle
  that hovered (11 m within 8 s; another drifted 1.5 m). With them it drifts as its horizon errs: blind landings from
  1 m by 0.2 to 2.2 m (recorded: 0.4 to 1.6 m).
- PX4 checks its modes at 10 Hz; the mock, at 20 Hz and 0.05 s later for setpoints, notices a loss of them 0.05 to 0.1 s
  late, as the flights' recordings do. How long a landing takes to be noticed is drawn from what was recorded.
- The mock notices every landing. Of two recorded ones without vision PX4 noticed the one in Altitude mode; in Land it
  had not done so when the record ended, 4 s after the touchdown: its estimate went on creeping at 0.12 to 0.27 m/s.
- It has a distance sensor, as the recorded simulator, and lands slowly with it unless EKF2_RNG_CTRL is 0.
- The attitude loop is a second-order response behind a torque lag and 14 ms of delay, fitted to the step responses
  of section l. Torques have no limit.
- Drag is the airframe's; section l uses the recorded simulator's (1 kg, 20 N, 1 N per m/s). The mock's own vehicle, of
  4.85 kg, has half as much for its weight: its thrust steps are 20 to 60 % faster.
- Return is climb, straight line, land; take-off has no smoothed trajectory.
- ODOMETRY is taken as local NED whatever its frame_id; a position beyond 100 km is ignored. Velocities in it that
  contradict its positions for 2 s in the air end the local position, as PX4's estimator checks do, until it stands.
- A pilot has sticks (MANUAL_CONTROL), no switches. In Position they are taken to be at rest.
- The hover thrust is learnt in PX4's own modes by a first-order lag of 2 s; PX4's estimator is a Kalman filter.
- Of PX4's checks before arming the mock has those of modes, setpoints, sticks and battery, and those of poses against
  the estimate (position, height). Accelerometer and gyroscope biases never fail it.
- EVENT messages come for texts only, not for health reports.
- Not simulated: missions, geofence, MAVLink FTP, log download, position and velocity setpoints in OFFBOARD.
"""


def measure() -> list[tuple[Fact, Value]]:
    """Return every fact with the mock's value."""
    return [(fact, fact.measure()) for fact in FACTS]


def document(measured: list[tuple[Fact, Value]]) -> str:
    """Return the whole text of docs/px4-conformance.md."""
    by_source = sum(fact.section == "n" for fact, _ in measured)
    lines = [HEAD.format(count=len(measured) - by_source, source_count=by_source)]
    for key, title in SECTIONS.items():
        rows = [(fact, value) for fact, value in measured if fact.section == key]
        if not rows:
            continue
        lines += [f"## {title}", "", HEADINGS, RULE]
        lines += [
            f"| {f.id} | {f.what} | {f.px4} | {f.show(v)} | {f.tolerance} | {f.source or RECORDINGS[key]} |"
            for f, v in rows
        ]
        lines.append("")
    return "\n".join(lines)


def main() -> int:
    """Write the page; 1 when a fact does not hold."""
    measured = measure()
    DOCUMENT.parent.mkdir(exist_ok=True)
    DOCUMENT.write_text(document(measured) + "\n" + section(compared()), encoding="utf-8")
    wrong = [f"{fact.id}: PX4 {fact.px4}, mock {fact.show(value)}" for fact, value in measured if not fact.holds(value)]
    print("\n".join([f"{len(measured)} facts, {len(wrong)} differ", *wrong]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
