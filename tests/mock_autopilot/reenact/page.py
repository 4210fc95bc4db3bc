"""The section of docs/px4-conformance.md on the re-enacted sessions."""

from collections.abc import Mapping, Sequence

from tests.mock_autopilot.reenact.compare import Row
from tests.mock_autopilot.reenact.tolerances import RULES, Tolerance

TITLE = "## The recorded sessions, re-enacted"
CONTENT = {
    "nominal-px4-b": "arm, take off, hover, ellipse, figure-eight, other laws, land (a quiet stretch is left out)",
    "short-px4-tight": "the same, shorter, with an EKF told how good motion capture is",
    "px4-battery": "the battery drains within 60 s; the companion lands at 25 %",
    "px4-kill9": "the companion is killed in hover: setpoints and poses end together, PX4 lands blind",
    "px4-killcmd": "the companion stops the motors in hover",
    "px4-mocap02": "motion capture silent for 0.2 s",
    "px4-mocap1": "motion capture silent for 1 s: the companion lets PX4 land",
    "px4-mocap_gone": "motion capture silent for good",
    "px4-pilot_hold": "a ground station asks for Hold, which PX4 refuses",
    "px4-pilot_position": "a ground station asks for Position; 5 s later the companion takes it back",
    "px4-px4_killed": "PX4 is killed in hover and booted 5 s later; then a whole flight",
    "px4-rc_lost": "the joystick is gone",
    "px4-sigstop": "the companion is stopped in hover, and killed by its dead man's switch",
}
HEAD = """
Recorded from PX4 v1.17.0 in simulation (SIH quadrotor, 1 kg, no GPS, motion capture at 100 Hz) on 2026-11-29, with this
companion on the other end of the link. What PX4 heard then goes into the mock, frame by frame, in simulated time:
commands, questions, heartbeats, sticks and parameters as they were; the setpoints with their recorded times, and in
the air with a pull towards the recorded way, since two plants drift apart; poses at their recorded times, of where the
mock's vehicle is. What the mock tells is read from its frames by the code that reads the recording, and compared one
by one: every answer and text, and every change of mode, state, landed state, health bit, estimator flag and charge.
What waits for PX4 to disarm (setpoints of an idle vehicle, the question for disarming) waits as long as the mock takes.

`python -m tests.mock_autopilot.reenact FILE.tlog...` does the same with any log that begins with PX4's boot, and prints
every event with both times. "By chance" are events that PX4 tells in some flights and not in others, and states that
were over before their message was due again.

Not compared: the way flown, the rates of the ground station's link, the parameters that PX4 announces unasked, EVENT,
and the height-above-ground flag of ESTIMATOR_STATUS, which comes and goes.
"""


def section(compared: Mapping[str, Sequence[Row]]) -> str:
    """Return the conformance page's section on recorded sessions."""
    lines = [TITLE, HEAD, "| session | what happens | events | by chance | differ |", "| --- | --- | --- | --- | --- |"]
    lines += [_session_line(name, rows) for name, rows in compared.items()]
    lines += _differences(compared)
    lines += ["", "| message | event | accepted, s | spread among the recordings |", "| --- | --- | --- | --- |"]
    lines += [f"| {channel} | {_words(pattern)} | {_range(rule)} | {rule.source} |" for channel, pattern, rule in RULES]
    return "\n".join(lines) + "\n"


def _session_line(name: str, rows: Sequence[Row]) -> str:
    chance = sum(row.verdict == "by chance" for row in rows)
    return f"| {name} | {CONTENT.get(name, '')} | {len(rows)} | {chance} | {sum(row.differs for row in rows)} |"


def _differences(compared: Mapping[str, Sequence[Row]]) -> list[str]:
    """Return a table of what differs; nothing when nothing does."""
    different = [(name, row) for name, rows in compared.items() for row in rows if row.differs]
    if not different:
        return []
    head = ["", "| session | event | recorded, s | mock, s |", "| --- | --- | --- | --- |"]
    return head + [
        f"| {name} | {row.channel} {row.what} | {_time(row.recorded_s)} | {_time(row.mock_s)} |"
        for name, row in different
    ]


def _time(at_s: float | None) -> str:
    return "-" if at_s is None else f"{at_s:.2f}"


def _range(rule: Tolerance) -> str:
    return f"{-rule.early_s:+.2f} to {rule.late_s:+.2f}" + (", or not at all" if rule.optional else "")


def _words(pattern: str) -> str:
    return pattern.replace("|", ", ") or "all others"
