"""State of one joint and its servo, and the rate limit of its goals; used by the bus thread only."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from companion.adapters.dynamixel.conversion import Health, JointScale, Reading, at_least_one
from companion.adapters.dynamixel.registers import AX_ALARMS, Answer, Ax, Xm
from companion.arms.model import JOINT_NAMES, KINDS, JointLimit
from companion.config.arms_config import ArmsConfig
from companion.core.types import ArmFaultKind

LIMITER_HEADROOM = 1.2
"""Factor on the joint's speed limit for goals: a feasible trajectory is never limited."""
PROFILE_VELOCITY_HEADROOM = 1.5
PROFILE_ACCEL_HEADROOM = 3.0
"""The servo's own profile is the second guard. Its lag behind streamed goals is v^2 / 2a, so it gets room."""
_STEPS = 5
"""Cycles over which the speed of the goals is estimated."""


@dataclass(kw_only=True)
class Joint:
    """One servo in its joint."""

    index: int
    name: str
    servo_id: int
    scale: JointScale
    limit: JointLimit
    heard_s: float = -math.inf
    missed: int = 0
    """Times in a row that it was asked by itself and did not answer."""
    missed_s: float = math.inf
    """When that began."""
    in_group: bool = True
    """Read together with the others; otherwise asked by itself."""
    next_try_s: float = -math.inf
    paused: bool = False
    """Rebooting: not asked at all."""
    reading: Reading | None = None
    torque_on: bool = False
    """Torque Enable as last read."""
    driven: bool = False
    """We have switched its torque on, and send it goals."""
    sent_rad: float = math.nan
    wanted_rad: float = math.nan
    stopping: bool = False
    """The goals are being brought to rest, where they were going."""
    steps: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_STEPS))
    """Last steps of the sent goals, each (s, rad)."""
    faults: set[ArmFaultKind] = field(default_factory=set)

    @property
    def protocol(self) -> int:
        """DYNAMIXEL protocol of the servo, 1 (AX) or 2 (XM)."""
        return self.scale.model.protocol

    @property
    def table(self) -> type[Ax] | type[Xm]:
        """Control table of the servo."""
        return self.scale.model.table

    @property
    def label(self) -> str:
        """Joint name and servo ID for messages, such as "left_shoulder (ID 1)"."""
        return f"{self.name} (ID {self.servo_id})"

    @property
    def held_rad(self) -> float:
        """The goal that holds it; NaN while it gets none from us."""
        return self.sent_rad if self.driven else math.nan

    @property
    def profile(self) -> bytes:
        """XM: Profile Acceleration and Profile Velocity; AX: Moving Speed."""
        velocity_radps = PROFILE_VELOCITY_HEADROOM * self.limit.max_velocity_radps
        if self.protocol == 1:
            return Ax.MOVING_SPEED.encoded(at_least_one(velocity_radps, Ax.MOVING_SPEED))
        accel_radps2 = PROFILE_ACCEL_HEADROOM * self.limit.max_accel_radps2
        return Xm.PROFILE_ACCELERATION.encoded(
            at_least_one(accel_radps2, Xm.PROFILE_ACCELERATION)
        ) + Xm.PROFILE_VELOCITY.encoded(at_least_one(velocity_radps, Xm.PROFILE_VELOCITY))

    def hear(self, state: Answer, now_s: float) -> None:
        """Store a newly received state block and mark the servo as answering."""
        self.reading = self.scale.reading(state)
        self.heard_s, self.missed, self.missed_s, self.in_group = now_s, 0, math.inf, True

    def health_of(self, health: Answer) -> Health:
        """Return torque state and errors from the table's HEALTH block."""
        torque_on = bool(health.raw(self.table.TORQUE_ENABLE))
        if self.protocol == 2:
            return Health(torque_on, health.raw(Xm.HARDWARE_ERROR))
        errors = health.error & sum(AX_ALARMS)
        return Health(torque_on, errors, health.raw(Ax.MOVING_SPEED), not health.raw(Ax.TORQUE_LIMIT))

    def begin_driving(self, goal_rad: float) -> None:
        """Start sending goals, beginning with the goal that the servo has."""
        self.driven = self.torque_on = True
        self.sent_rad = self.wanted_rad = goal_rad
        self.steps.clear()

    def order(self, goal_rad: float) -> None:
        """Set the goal, clamped to the limits; a joint held outside them moves only by a goal inside."""
        low, high = min(self.limit.min_rad, self.sent_rad), max(self.limit.max_rad, self.sent_rad)
        self.wanted_rad, self.stopping = min(max(goal_rad, low), high), False

    def stop(self) -> None:
        """Bring the goals to rest from where and how they move, or leave the one that stands.

        Never from where the joint was seen: that is behind its goal, long behind when it was read a while ago, or far
        from it under a load, and an arm would run back, a claw open.
        """
        self.order(stopping_point(self.sent_rad, goal_velocity(tuple(self.steps)), self.limit.max_accel_radps2))
        self.stopping = True

    def advance(self, dt_s: float) -> float:
        """Return the next goal, rad, to send `dt_s` after the last one."""
        fastest = LIMITER_HEADROOM * self.limit.max_velocity_radps
        if self.stopping:
            fastest = min(fastest, braking_velocity(self.wanted_rad - self.sent_rad, self.limit.max_accel_radps2))
        before, self.sent_rad = self.sent_rad, next_goal(self.sent_rad, self.wanted_rad, fastest, dt_s)
        self.steps.append((dt_s, self.sent_rad - before))
        return self.sent_rad


def joints_of(config: ArmsConfig) -> tuple[Joint, ...]:
    """Return the joints of this configuration in the order of JOINT_NAMES."""
    limits = config.model().limits
    return tuple(
        Joint(
            index=index,
            name=name,
            servo_id=config.servos[name].id,
            scale=JointScale.of(config.servos[name]),
            limit=limits[index % len(KINDS)],
        )
        for index, name in enumerate(JOINT_NAMES)
    )


def next_goal(sent_rad: float, wanted_rad: float, max_velocity_radps: float, dt_s: float) -> float:
    """Return the next goal, rad: the last one moved towards the wanted one, no faster than the limit."""
    step_rad = max_velocity_radps * max(dt_s, 0.0)
    return sent_rad + min(max(wanted_rad - sent_rad, -step_rad), step_rad)


def goal_velocity(steps: Sequence[tuple[float, float]]) -> float:
    """Return the velocity, rad/s, of goals whose last `steps` were (s, rad), newest last; 0 after a reversal.

    Two clocks beat against each other, so that now and then a cycle finds no new goal and the next one finds two: one
    step says little. Of all steps and the last two the slower is taken, so that no stop is longer than needed.
    """
    newest, all_of_them = _mean_velocity(steps[-2:]), _mean_velocity(steps)
    if newest * all_of_them <= 0.0 or newest * steps[-1][1] < 0.0:
        return 0.0
    return min(newest, all_of_them, key=abs)


def _mean_velocity(steps: Sequence[tuple[float, float]]) -> float:
    took_s = math.fsum(dt_s for dt_s, _ in steps)
    return math.fsum(step_rad for _, step_rad in steps) / took_s if took_s > 0.0 else 0.0


def stopping_point(goal_rad: float, velocity_radps: float, max_accel_radps2: float) -> float:
    """Return the angle, rad, at which a moving goal stops with maximum deceleration, v^2 / 2a ahead."""
    return goal_rad + math.copysign(velocity_radps**2 / (2.0 * max_accel_radps2), velocity_radps)


def braking_velocity(left_rad: float, max_accel_radps2: float) -> float:
    """Return the highest speed, rad/s, from which a goal stops within `left_rad`: v = sqrt(2 a s)."""
    return math.sqrt(2.0 * max_accel_radps2 * abs(left_rad))
