"""The arms' motion as a table: what the simulated world's arms do under the same goals, in steps of any length."""

import math
from pathlib import Path

import numpy as np
import pytest

from mock_autopilot.config import ArmsConfig, MockConfig
from mock_autopilot.physics.arm_bodies import Moving, add, arm_motion
from mock_autopilot.physics.arm_table import SETTLE_S, ArmTable, table_of
from mock_autopilot.world import STEP_S, World

CONFIG = MockConfig.load(Path(__file__).parents[3] / "config" / "mock.toml")
PERIOD_S, DURATION_S = 0.01, 2.0
COLUMNS = ("moment", "momentum", "force", "torque")


def _goals() -> np.ndarray:
    """Return goals (m, 8) from the stowed pose on: all joints of both arms differently, the claws too."""
    time_s = np.arange(round(DURATION_S / PERIOD_S))[:, None] * PERIOD_S
    stowed = np.array([servo.start_position_rad or 0.0 for servo in CONFIG.arms.bus.servos]) - CONFIG.arms.zero_rad
    swing = np.array([0.4, -0.5, 0.3, 0.2, 0.3, -0.6, 0.2, 0.1])
    return np.asarray(stowed + swing * (1.0 - np.cos(2.0 * math.pi * time_s / 1.5)))


def _table(step_s: float, config: ArmsConfig = CONFIG.arms) -> ArmTable:
    return table_of(config, _goals(), PERIOD_S, step_s)


def _flown() -> tuple[list[Moving], list[np.ndarray]]:
    """Both arms' sums and joint angles after every step of the simulated world."""
    world = World(CONFIG)
    assert world.arms is not None
    assert world.servos is not None
    arms, motors = world.arms, [servo.motor for servo in world.servos.servos]
    seen: list[Moving] = []
    joints: list[np.ndarray] = []

    def look(_: object) -> None:
        sides = zip(arms.now, (1.0, -1.0), strict=True)
        right, left = (arm_motion(arms.assembly.bodies, state, outward) for state, outward in sides)
        seen.append(add(right, left))
        joints.append(arms.joints_rad)

    for motor in motors:
        motor.power(on=True)
    world.advance(SETTLE_S)
    world.observers.append(look)
    for index, goal in enumerate(_goals() + CONFIG.arms.zero_rad):
        for motor, angle in zip(motors, goal.tolist(), strict=True):
            motor.go_to(angle)
        world.advance(SETTLE_S + (index + 1) * PERIOD_S)
    return seen, joints


def test_at_the_servos_own_step_it_is_what_the_world_has() -> None:
    table, (seen, joints) = _table(STEP_S), _flown()
    assert table.joints_rad == pytest.approx(np.array(joints), abs=1e-12)
    for name in COLUMNS:
        flown = np.array([getattr(moving, name) for moving in seen])
        assert np.abs(flown).max() > 0.01, f"{name}: nothing moves"
        assert getattr(table, name) == pytest.approx(flown, abs=1e-8)
    assert table.at(100).force == pytest.approx(seen[100].force, abs=1e-8)


@pytest.mark.parametrize("step_s", [0.005, 0.01])
def test_longer_steps_have_the_mean_and_lose_no_impulse(step_s: float) -> None:
    long, short = _table(step_s), _table(STEP_S)
    assert len(long.force) == round(DURATION_S / step_s)
    assert long.force.sum(axis=0) * step_s == pytest.approx(short.force.sum(axis=0) * STEP_S, abs=1e-9)
    for name in COLUMNS:
        pairs = getattr(long, name).reshape(-1, 2, 3).mean(axis=1)  # a whole number of the servos' steps
        each = round(2 * step_s / STEP_S)
        means = getattr(short, name).reshape(-1, each, 3).mean(axis=1)
        assert pairs == pytest.approx(means, abs=1e-9)
    assert long.joints_rad[1] == pytest.approx(short.joints_rad[round(2 * step_s / STEP_S) - 1])


def test_servos_that_turn_the_other_way_move_the_same_links() -> None:
    turned = CONFIG.arms.model_copy(update={"direction": (-1,) * 8})
    mirrored, plain = _table(0.005, turned), _table(0.005)
    assert mirrored.joints_rad == pytest.approx(plain.joints_rad, abs=1e-12)
    assert mirrored.force == pytest.approx(plain.force, abs=1e-8)


def test_it_begins_at_rest_where_the_servos_hold_the_first_goal() -> None:
    held = table_of(CONFIG.arms, np.tile(_goals()[37], (3, 1)), PERIOD_S, STEP_S)
    assert held.joints_rad[0] == pytest.approx(_goals()[37], abs=0.02)
    assert held.joints_rad[0, 1] < _goals()[37, 1] - 0.005, "a raised forearm sags"
    assert not held.momentum.any()
