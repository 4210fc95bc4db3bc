"""Plan of the next moments that the vehicle sends to the ground: knots in, reference and arm motion out. Pure.

Between two knots position, velocity and acceleration are joined by the quintic of these six values (Hermite). It is off
by less than a micrometre on laps, and by some 20 um where a move to a position begins or ends.
"""

from collections.abc import Callable
from math import remainder, tau

import numpy as np

from companion.core.types import Array, JointMotion, Reference
from companion.law_link.messages import TICK_S, Knot, Plan, seconds_between, ticks_of

SPACING_S = 0.2
"""Time between two knots."""
KNOTS = 4
"""Knots of a plan: with a plan every SPACING_S, two may be lost."""
_YAW_STEP_S = 0.01
_MOTION = 8


def knot_at(time_s: float, reference_at: Callable[[float], Reference], joints: JointMotion | None) -> Knot:
    """Return the knot of a reference, and of the arms' motion if there are arms."""
    here = reference_at(time_s)
    turn_rad = remainder(reference_at(time_s + _YAW_STEP_S).yaw_rad - here.yaw_rad, tau)
    return Knot(
        position_w_m=_three(here.position_w_m),
        velocity_w_mps=_three(here.velocity_w_mps),
        acceleration_w_mps2=_three(here.acceleration_w_mps2),
        yaw_rad=here.yaw_rad,
        yaw_rate_radps=turn_rad / _YAW_STEP_S,
        joints=() if joints is None else _joints(joints),
    )


def _three(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _joints(motion: JointMotion) -> tuple[float, ...]:
    return tuple(np.concatenate((motion.position_rad, motion.velocity_radps, motion.acceleration_radps2)).tolist())


class PlannedMotion:
    """Reference and arm motion over the vehicle's time, by the newest plan."""

    def __init__(self, plan: Plan) -> None:
        self._begin, self._spacing_s = plan.begin, plan.spacing * TICK_S
        self._times = len(plan.knots)
        self._reference = np.array([(k.position_w_m, k.velocity_w_mps, k.acceleration_w_mps2) for k in plan.knots])
        self._yaw = [(k.yaw_rad, k.yaw_rate_radps) for k in plan.knots]
        joints = np.array([k.joints for k in plan.knots])
        self._joints = joints.reshape(self._times, 3, _MOTION) if joints.size else None

    @property
    def length_s(self) -> float:
        """Time from the first knot to the last."""
        return (self._times - 1) * self._spacing_s

    def since_begin_s(self, vehicle_s: float) -> float:
        """Return the time (s) since the first knot, at a time of the vehicle's clock."""
        return seconds_between(ticks_of(vehicle_s), self._begin)

    def reference(self, vehicle_s: float) -> Reference:
        """Return the reference at a time of the vehicle's clock; beyond the last knot its velocity goes on."""
        first, part_s = self._between(vehicle_s)
        position, velocity, acceleration = self._joined(self._reference, first, part_s)
        return Reference(position, velocity, acceleration, self._yaw_rad(first, part_s))

    def joints(self, vehicle_s: float) -> JointMotion | None:
        """Return the commanded motion of the joints, (8,) each; None for a vehicle without arms."""
        if self._joints is None:
            return None
        return JointMotion(*self._joined(self._joints, *self._between(vehicle_s)))

    def _between(self, vehicle_s: float) -> tuple[int, float]:
        """Return the knot before this time, and the time since it (s)."""
        since_s = max(self.since_begin_s(vehicle_s), 0.0)
        first = min(int(since_s / self._spacing_s), self._times - 1)
        return first, since_s - first * self._spacing_s

    def _joined(self, knots: Array, first: int, part_s: float) -> tuple[Array, Array, Array]:
        (p, v, a), h = knots[first], self._spacing_s
        if first == self._times - 1:
            return p + part_s * v, v, np.zeros_like(a)
        q, w, b = knots[first + 1]
        x = part_s / h
        gap, speed, bend = q - p - h * v - 0.5 * h * h * a, h * (w - v - h * a), h * h * (b - a)
        c3, c4, c5 = 10 * gap - 4 * speed + 0.5 * bend, -15 * gap + 7 * speed - bend, 6 * gap - 3 * speed + 0.5 * bend
        position = p + part_s * v + 0.5 * part_s**2 * a + x**3 * (c3 + x * (c4 + x * c5))
        velocity = v + part_s * a + x**2 * (3 * c3 + x * (4 * c4 + x * 5 * c5)) / h
        acceleration = a + x * (6 * c3 + x * (12 * c4 + x * 20 * c5)) / h**2
        return position, velocity, acceleration

    def _yaw_rad(self, first: int, part_s: float) -> float:
        (yaw, rate), h = self._yaw[first], self._spacing_s
        if first == self._times - 1:
            return yaw + part_s * rate
        end, end_rate = self._yaw[first + 1]
        x, gap = part_s / h, remainder(end - yaw, tau)
        return (
            yaw + part_s * rate + x * x * (3 * gap - h * (2 * rate + end_rate) + x * (h * (rate + end_rate) - 2 * gap))
        )


def plan_of(
    now_s: float, reference_at: Callable[[float], Reference], joints_at: Callable[[float], JointMotion] | None
) -> Plan:
    """Return the plan from now on; session and sequence are given to it when it is sent."""
    knots = []
    for index in range(KNOTS):
        time_s = now_s + index * SPACING_S
        knots.append(knot_at(time_s, reference_at, None if joints_at is None else joints_at(time_s)))
    return Plan(session=0, sequence=0, begin=ticks_of(now_s), spacing=ticks_of(SPACING_S), knots=tuple(knots))
