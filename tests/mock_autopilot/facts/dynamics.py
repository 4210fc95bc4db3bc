"""Step responses (section l), with the recorded simulator's airframe."""

import csv
import math
from functools import cache, partial
from pathlib import Path

import numpy as np

from mock_autopilot.physics import plant, plant_one
from mock_autopilot.physics import quaternion as quat
from mock_autopilot.physics.plant import Actuation, PlantParams
from mock_autopilot.physics.quaternion import Array
from tests.mock_autopilot.bench import SIH_PLANT, Bench
from tests.mock_autopilot.fact import Fact, near

DATA = Path(__file__).parents[2] / "data"
FRACTIONS = (0.1, 0.5, 0.63, 0.9)
ROLL, PITCH, YAW = 0, 1, 2
RECORDED = {
    "roll": (ROLL, 10.0, (103, 230, 277, 431), 2.0),
    "pitch": (PITCH, 10.0, (103, 225, 266, 429), 1.0),
    "yaw": (YAW, 30.0, (279, 543, 617, 770), 27.0),
}
"""Axis, step (deg), times (ms) to 10, 50, 63 and 90 %, overshoot (%)."""
THRUST = {0.3: 2.4, 0.4: 1.3, 0.45: 0.6, 0.5: 0.0, 0.55: -0.5, 0.6: -1.4, 0.7: -2.7, 0.8: -4.0, 0.9: -5.4, 1.0: -6.3}
"""Mean downward acceleration (m/s^2) from 0.25 to 0.7 s after a step from hover."""


def _hover() -> Bench:
    return _flight().again()


@cache
def _flight() -> Bench:
    bench = Bench(plant=SIH_PLANT)
    bench.run(4.2)
    bench.fly_offboard(8.0, thrust=0.4905)
    bench.run(1.0)
    return bench


@cache
def _step(axis: int, step_deg: float) -> tuple[list[float], float]:
    """Times (ms) to the fractions and the overshoot (%), from the setpoint frame."""
    bench = _hover()
    angles = [0.0, 0.0, 0.0]
    angles[axis] = math.radians(step_deg)
    bench.run(0.02 - (bench.now_s % 0.02))
    bench.target(0.4905, tuple(quat.from_euler(*angles).tolist()))
    start, shares = bench.now_s, []
    times = np.arange(1, 1000) * 0.002
    bench.hear(bench.setpoint)
    for at_s in times:
        bench.world.advance(start + at_s)
        if round(at_s * 1000) % 20 == 0:
            bench.hear(bench.setpoint)
        shares.append(quat.to_euler(bench.world.truth.q_ned_frd_wxyz)[axis] / angles[axis])
    reached = [float(times[next(i for i, s in enumerate(shares) if s >= part)]) * 1e3 for part in FRACTIONS]
    return reached, 100.0 * (max(shares) - 1.0)


def _time_ms(axis: int, step_deg: float, index: int) -> float:
    return _step(axis, step_deg)[0][index]


def _overshoot(axis: int, step_deg: float) -> float:
    return _step(axis, step_deg)[1]


def _attitude_facts() -> list[Fact]:
    facts = []
    for name, (axis, step_deg, recorded_ms, overshoot) in RECORDED.items():
        for index, (part, ms) in enumerate(zip(FRACTIONS, recorded_ms, strict=True)):
            facts.append(
                near(
                    f"l-{name}-{part * 100:.0f}",
                    f"{name}, {step_deg:.0f} deg step: {part:.0%}",
                    f"{ms} ms",
                    partial(_time_ms, axis, step_deg, index),
                    (ms - 25.0, ms + 25.0),
                    "ms",
                )
            )
        facts.append(
            near(
                f"l-{name}-overshoot",
                f"{name}: overshoot",
                f"{overshoot:.0f} %",
                partial(_overshoot, axis, step_deg),
                (max(overshoot - 4.0, -0.5), overshoot + 4.0),
                "%",
            )
        )
    return facts


@cache
def _replay() -> tuple[float, float, float]:
    """Rms (deg) over 38 s of recorded steps between PX4's roll, pitch, yaw and the plant's, axis by axis."""
    setpoints, recorded = _table("px4_attitude_setpoints.csv"), _table("px4_attitude_steps.csv")
    delay_s = Bench().world.attitude_delay_s
    state, time_s, errors = plant.at_rest(np.array([0.0, 0.0, -1e6])), -0.5, []
    for row in recorded:
        while time_s < row[0]:
            latest = np.searchsorted(setpoints[:, 0], time_s - delay_s, side="right") - 1
            q_sp = quat.from_euler(*np.radians(setpoints[latest, 1:]).tolist())
            state = plant_one.step(state, Actuation(q_sp, np.asarray(0.5)), plant.no_wrench(), PlantParams(), 0.002)
            time_s += 0.002
        errors.append(np.degrees(quat.to_euler(state.q_ned_frd_wxyz)) - row[4:])
    roll, pitch, yaw = np.sqrt(np.mean(np.square(errors), axis=0)).tolist()
    return roll, pitch, yaw


def _table(name: str) -> Array:
    with (DATA / name).open(encoding="ascii") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    return np.array(rows[1:], dtype=float)


def _rms(axis: int) -> float:
    return _replay()[axis]


def _acceleration(thrust: float) -> float:
    bench = _hover()
    bench.target(thrust)
    bench.run(0.252)
    before, at_s = bench.world.truth.velocity_ned_mps[2], bench.now_s
    bench.run(0.448)
    return float((bench.world.truth.velocity_ned_mps[2] - before) / (bench.now_s - at_s))


def _motor_lag() -> float:
    """Milliseconds from the setpoint to 63 % of a thrust step."""
    bench = _hover()
    bench.target(0.6)
    bench.hear(bench.setpoint)
    start, before = bench.now_s, float(bench.world.state.thrust_n)
    while float(bench.world.state.thrust_n) - before < 0.63 * (12.0 - before):
        bench.world.advance(bench.now_s + 0.002)
    return (bench.now_s - start) * 1e3


FACTS = (
    *_attitude_facts(),
    *(
        near(
            f"l-thrust-{u:g}",
            f"thrust {u:g} from hover: mean dvz/dt from 0.25 to 0.7 s",
            f"{a:+.1f} m/s2",
            partial(_acceleration, u),
            (a - max(0.35, 0.08 * abs(a)), a + max(0.35, 0.08 * abs(a))),
            "m/s2",
        )
        for u, a in THRUST.items()
    ),
    *(
        near(
            f"l-{name}-replay",
            f"{name} over 38 s of recorded steps: rms of the difference",
            "0 deg",
            partial(_rms, i),
            limit,
            "deg",
        )
        for i, (name, limit) in enumerate((("roll", (0.0, 0.7)), ("pitch", (0.0, 0.5)), ("yaw", (0.0, 1.3))))
    ),
    near("l-motor-lag", "thrust step: 63 % after", "about 50 ms", _motor_lag, (40.0, 70.0), "ms"),
)
