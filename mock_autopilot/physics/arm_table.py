"""The arms' motion worked out beforehand: servos feel the links' weight but not the vehicle, which may be any."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mock_autopilot.config import ArmsConfig
from mock_autopilot.physics.arm_bodies import JOINTS_PER_ARM, JointState, Moving, Three, add, arm_motion
from mock_autopilot.physics.arms import OUTWARD, Assembly
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.servos.motor import Motor
from mock_autopilot.servos.rack import ServoRack
from mock_autopilot.world import STEP_S

SETTLE_S = 0.5
"""Before the table begins the first goal is held so long: by then the links have sagged as far as they do."""
SETTLE_STEPS = round(SETTLE_S / STEP_S)


@dataclass(frozen=True)
class ArmTable:
    """Both arms' sums (arm_bodies.Moving, FRD, (n, 3)), each its mean over a step: step k is k step_s to (k+1) step_s.

    Means, so that no impulse gets lost where the steps are longer than the servos' own of 2 ms.
    """

    step_s: float
    moment: Array
    momentum: Array
    force: Array
    torque: Array
    joints_rad: Array
    """True joint angles at the end of each step, claws included, (n, 8)."""

    def at(self, step: int) -> Moving:
        """Return the arms' mean sums during that step."""
        return self._moving[step]

    @property
    def first(self) -> Moving:
        """Return the arms' mean sums during the first step, without those of all others."""
        return Moving(*(_three(column[0]) for column in (self.moment, self.momentum, self.force, self.torque)))

    @cached_property
    def _moving(self) -> list[Moving]:
        columns = (self.moment, self.momentum, self.force, self.torque)
        rows = zip(*(map(tuple, column.tolist()) for column in columns), strict=True)
        return [Moving(*row) for row in rows]


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Servos to be driven to goals."""

    assembly: Assembly
    motors: Sequence[Motor]
    """At rest at the first goal, torque on."""
    goals_rad: Array
    """The servos' own angles, (m, 8)."""
    due: Sequence[int]
    """Steps at which the goals arrive, (m,), not before step 0."""
    count: int
    """Steps from step 0 on; SETTLE_S before that, all begins."""


def table_of(
    config: ArmsConfig,
    goals_rad: Array,
    goal_period_s: float,
    step_s: float,
    driven: Callable[[Drive], Array] | None = None,
) -> ArmTable:
    """Drive the configured servos to joint goals (m, 8), one every `goal_period_s`, and tabulate the links' motion.

    The arms begin at rest where they hold the first goal, torque on; goals reach the servos at once. Left out is what
    takes a servo out of service: faults, overload and heat. `driven` does in less time what `angles_of` does.
    """
    assembly = config.assembly()
    steps = round(len(goals_rad) * goal_period_s / step_s)
    count = math.ceil(steps * step_s / STEP_S - 1e-6)
    sign, zero = np.array(assembly.direction), np.array(assembly.zero_rad)
    drive = _drive(config, assembly, sign * goals_rad + zero, goal_period_s, count)
    joints = sign * ((driven or angles_of)(drive) - zero)
    # A motor's own step is angle += rate dt after rate += accel dt: differences give back exactly what it had.
    rates = np.diff(joints, axis=0, prepend=joints[:1]) / STEP_S
    accels = np.diff(rates, axis=0, prepend=rates[:1]) / STEP_S
    moving = _moving(assembly, joints[1:], rates[1:], accels[1:])
    ends_s = np.arange(count + 1, dtype=np.float64) * STEP_S
    edges_s = np.arange(steps + 1, dtype=np.float64) * step_s
    columns = (moving.moment, moving.momentum, moving.force, moving.torque)
    moment, momentum, force, torque = (_means(np.stack(column, axis=-1), ends_s, edges_s) for column in columns)
    return ArmTable(step_s, moment, momentum, force, torque, _between(edges_s[1:], ends_s, joints))


def _drive(config: ArmsConfig, assembly: Assembly, goals: Array, goal_period_s: float, count: int) -> Drive:
    starts = zip(config.bus.servos, goals[0].tolist(), strict=True)
    servos = tuple(servo.model_copy(update={"start_position_rad": start}) for servo, start in starts)
    motors = [servo.motor for servo in ServoRack(config.bus.model_copy(update={"servos": servos})).servos]
    for motor in motors:
        motor.power(on=True)
    due = [math.ceil(index * goal_period_s / STEP_S - 1e-6) for index in range(len(goals))]
    return Drive(assembly=assembly, motors=motors, goals_rad=goals, due=due, count=count)


def angles_of(drive: Drive) -> Array:
    """Return the servos' own angles (rad) at the start and after each step, (count + 1, 8)."""
    motors, due = drive.motors, dict(zip(drive.due, drive.goals_rad.tolist(), strict=True))
    angles = [[motor.angle_rad for motor in motors]]
    for step in range(-SETTLE_STEPS, drive.count):
        if step in due:
            for motor, goal in zip(motors, due[step], strict=True):
                motor.go_to(goal)
        for motor, load_nm in zip(motors, drive.assembly.loads_nm(angles[-1]), strict=True):
            motor.step(STEP_S, load_nm)
        angles.append([motor.angle_rad for motor in motors])
    return np.array(angles[-drive.count - 1 :])


def _moving(assembly: Assembly, joints: Array, rates: Array, accels: Array) -> Moving:
    """Return both arms' sums at many instants, from (n, 8) each; the components are arrays (n,)."""

    def arm(first: int, outward: float) -> Moving:
        a, r, c = (_columns(values[:, first : first + 3]) for values in (joints, rates, accels))
        return arm_motion(assembly.bodies, JointState(a, r, c), outward)

    right, left = (arm(side * JOINTS_PER_ARM, outward) for side, outward in enumerate(OUTWARD))
    return add(right, left)


def _three(row: Array) -> Three:
    x, y, z = row.tolist()
    return x, y, z


def _columns(values: Array) -> Any:
    return tuple(np.ascontiguousarray(values.T))


def _means(values: Array, ends_s: Array, edges_s: Array) -> Array:
    """Return the means between the edges of values (n, 3), each of which holds up to its `ends_s[1:]`."""
    integral = np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0) * STEP_S))
    return np.asarray(np.diff(_between(edges_s, ends_s, integral), axis=0) / np.diff(edges_s)[:, None])


def _between(at_s: Array, times_s: Array, values: Array) -> Array:
    """Interpolate each column linearly at `at_s`."""
    return np.stack([np.interp(at_s, times_s, column) for column in values.T], axis=-1)
