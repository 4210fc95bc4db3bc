"""The guard in front of the actuators: the last gate, and what the age of the state and the fence forbid.

It knows neither controller nor supervisor, and believes neither: it looks at what is wanted, what went out last, and
the state it was computed from. Pure, single vehicle, plain floats.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from companion.core.types import Array, AttitudeThrust, VehicleState
from companion.geometry.attitude import ThrustModel, collective_force_n, limit_tilt, setpoint_of_accel
from companion.geometry.frames import quat_from_yaw, up_axis_parts, yaw_of
from companion.guard.geofence import Allowed, Fence, Range, Three
from companion.guard.limits import LimitedSetpoint, Limits, inside_cone, limit_setpoint

SINKING = 0.97
"""Share of hover thrust with which the vehicle comes down gently while nobody steers it."""
_INSET_M = 0.05
"""The fence is drawn in by what the prediction of the vehicle's answer may be wrong."""
_SHORTEST_S = 1e-3
"""A shorter time step, or none at all, counts as this: a clock that stands must not hold a tilt for ever."""
_LEAST_PUSH = 0.5
"""Share of the weight that stays on the rotors below a ceiling: what they brake sideways with."""
_YES = np.array(True)

Motion = tuple[Three, Three, Array]
"""Place (m), velocity (m/s), attitude."""
Near = tuple[Allowed, Array]
"""What the fence allows, and the vehicle's attitude."""


def most_braking_mps2(limits: Limits, model: ThrustModel) -> tuple[float, float]:
    """Largest deceleration the guard gives a vehicle sideways, at hover, and on its way up: what a fence may count on.

    On the way up the rotors keep half the weight, or what the least thrust gives if that is more.
    """
    kept_mps2 = max(_LEAST_PUSH * model.gravity_mps2, collective_force_n(limits.min_thrust, model) / model.mass_kg)
    return model.gravity_mps2 * math.tan(limits.max_tilt_rad), model.gravity_mps2 - kept_mps2


class Guard:
    """Cuts what is wanted to what may go out. It remembers nothing and never raises.

    Up to `coast_s` of age nothing is done because of it. Up to `degraded_s` the tilt cone shrinks to nothing and the
    thrust is drawn to just below hover; beyond, and without a state, the vehicle is level and sinks gently whatever is
    wanted, and the fence has no say, as nothing is known.

    Towards a face of the fence no more is asked for than leaves room to stop 5 cm before it: what may be asked for is
    Fence.allowed_accel_w_mps2. The other axes keep what they want as far as the tilt cone has room, which braking takes
    first; it holds a vehicle that wants to fall as far as braking sideways takes it, and never further than hover.
    Below a ceiling half the weight stays on the rotors. The heading is left as it is while it brakes.

    A legal flight goes through to the last bit. Legal is a speed towards a face that Fence's table has room for, and at
    rest half a metre before a face still a push of 2.5 m/s^2 towards it; along a face any speed.
    """

    def __init__(self, limits: Limits, model: ThrustModel, fence: Fence, coast_s: float, degraded_s: float) -> None:
        self._limits, self._model, self._coast_s, self._degraded_s = limits, model, coast_s, degraded_s
        (x0, y0), (x1, y1, z1) = fence.low_m, fence.high_m
        drawn_in = (x0 + _INSET_M, y0 + _INSET_M), (x1 - _INSET_M, y1 - _INSET_M, z1 - _INSET_M)
        self._fence = replace(fence, low_m=drawn_in[0], high_m=drawn_in[1])
        self._slope, self._upright = math.tan(limits.max_tilt_rad), math.cos(limits.max_tilt_rad)

    def check(
        self, wanted: AttitudeThrust, last: AttitudeThrust, vehicle: VehicleState | None, age_s: float, dt_s: float
    ) -> LimitedSetpoint:
        """What goes out instead of `wanted`, `dt_s` after `last`: always finite, and inside the limits.

        `vehicle` is the state that `wanted` was computed from, None when there is none; `age_s` is since its capture.
        """
        try:
            return self._checked(wanted, last, vehicle, age_s, dt_s if dt_s > _SHORTEST_S else _SHORTEST_S)
        except Exception as error:  # whatever it is: nothing goes out without a guard
            level = self.level(_heading_rad(last, wanted))
            words = f"{type(error).__name__}: {error}"
            return LimitedSetpoint(level, _YES, _YES, _YES, _YES, age_cut=_YES, fence_cut=_YES, failure=words)

    def level(self, yaw_rad: float) -> AttitudeThrust:
        """Level at this heading, sinking gently."""
        return AttitudeThrust(quat_from_yaw(yaw_rad), np.array(SINKING * self._model.hover_thrust))

    def _checked(
        self, wanted: AttitudeThrust, last: AttitudeThrust, vehicle: VehicleState | None, age_s: float, dt_s: float
    ) -> LimitedSetpoint:
        if _unusable(last):
            last = self.level(_heading_rad(wanted))
        motion = _motion(vehicle)
        known = 0.0 if motion is None else self._share_known(age_s)
        if motion is None or known == 0.0:
            return self._steered(wanted, last, dt_s, None, 0.0)
        allowed = self._allowed(motion, last)
        if known == 1.0 and self._passes(wanted, allowed):
            return limit_setpoint(wanted, last, self._limits, dt_s)
        return self._steered(wanted, last, dt_s, (allowed, motion[2]), known)

    def _steered(
        self, wanted: AttitudeThrust, last: AttitudeThrust, dt_s: float, near: Near | None, known: float
    ) -> LimitedSetpoint:
        """Cut to the cone and the thrust first, so that the brake is reckoned from what would go out; then slewed."""
        within = limit_setpoint(wanted, last, self._limits, math.inf)
        braked = within.setpoint if near is None else self._braked(within.setpoint, *near)
        target = braked if known == 1.0 else self._flattened(braked, known)
        if target is within.setpoint:
            return limit_setpoint(wanted, last, self._limits, dt_s)
        out = limit_setpoint(target, last, self._limits, dt_s)
        return replace(
            out,
            not_finite=within.not_finite,
            tilt_cut=np.asarray(within.tilt_cut | out.tilt_cut),
            thrust_cut=np.asarray(within.thrust_cut | out.thrust_cut),
            age_cut=np.array(known < 1.0),
            fence_cut=np.array(braked is not within.setpoint),
        )

    def _share_known(self, age_s: float) -> float:
        """1 while the state is fresh, 0 when it is too old or its age is no number; a clock may err either way."""
        if abs(age_s) <= self._coast_s:
            return 1.0
        if abs(age_s) < self._degraded_s:
            return (self._degraded_s - abs(age_s)) / (self._degraded_s - self._coast_s)
        return 0.0

    def _accel(self, q: Array, thrust: float) -> Three:
        """attitude.accel_of_setpoint in floats."""
        push = collective_force_n(thrust, self._model) / self._model.mass_kg
        x, y, z = up_axis_parts(q)
        return push * x, push * y, push * z - self._model.gravity_mps2

    def _allowed(self, motion: Motion, last: AttitudeThrust) -> Allowed:
        """Of each axis. What acts now is half what the vehicle's attitude gives, half what the last setpoint will."""
        (place, velocity, q), thrust = motion, float(last.thrust)
        here, there = self._accel(q, thrust), self._accel(last.q_w_flu_wxyz, thrust)
        carried = 0.5 * (here[0] + there[0]), 0.5 * (here[1] + there[1]), 0.5 * (here[2] + there[2])
        return self._fence.allowed_accel_w_mps2(place, velocity, carried)

    def _passes(self, wanted: AttitudeThrust, allowed: Allowed) -> bool:
        """Quick look: a setpoint inside the limits that asks for nothing forbidden. False for what is no number."""
        thrust = float(wanted.thrust)
        x, y, z = self._accel(wanted.q_w_flu_wxyz, thrust)
        (x0, x1), (y0, y1), (_, z1) = allowed
        inside = x0 <= x <= x1 and y0 <= y <= y1 and z <= z1
        return inside and self._limits.min_thrust <= thrust <= self._limits.max_thrust and self._stands(wanted)

    def _stands(self, wanted: AttitudeThrust) -> bool:
        return up_axis_parts(wanted.q_w_flu_wxyz)[2] >= self._upright and not _unusable(wanted)

    def _braked(self, wanted: AttitudeThrust, allowed: Allowed, now_q: Array) -> AttitudeThrust:
        """`wanted` itself where it asks for nothing forbidden, else what comes nearest to it and brakes.

        With the heading the vehicle has: to turn takes the attitude loop time that braking needs.
        """
        gravity = self._model.gravity_mps2
        x, y, z = self._accel(wanted.q_w_flu_wxyz, float(wanted.thrust))
        full = gravity * self._slope
        bx, by = _clipped(x, allowed[0], full), _clipped(y, allowed[1], full)
        bz = _clipped(z, allowed[2], (1.0 - _LEAST_PUSH) * gravity)
        if (bx, by, bz) == (x, y, z):
            return wanted
        brake = math.hypot(bx if bx != x else 0.0, by if by != y else 0.0)
        if bz == z:
            bz = max(z, min(brake / self._slope - gravity, 0.0))
        room = self._slope * (bz + gravity)
        if bx != x and by == y:
            by = _clipped(by, _around(room, bx), room)
        elif by != y and bx == x:
            bx = _clipped(bx, _around(room, by), room)
        accel = limit_tilt(np.array((bx, by, bz)), self._limits.max_tilt_rad, gravity)
        return setpoint_of_accel(accel, float(yaw_of(now_q)), self._model)

    def _flattened(self, wanted: AttitudeThrust, known: float) -> AttitudeThrust:
        """The less is known the nearer to level, sinking gently."""
        q, _ = inside_cone(wanted.q_w_flu_wxyz, known * self._limits.max_tilt_rad)
        thrust, sinking = float(wanted.thrust), SINKING * self._model.hover_thrust
        return AttitudeThrust(q, np.array(known * thrust + (1.0 - known) * sinking))


def _clipped(accel_mps2: float, allowed: Range, full_mps2: float) -> float:
    """Into the allowed range, but forced no harder than `full`."""
    low, high = min(allowed[0], full_mps2), max(allowed[1], -full_mps2)
    return max(low, min(high, accel_mps2))


def _around(room: float, taken: float) -> Range:
    """What one axis may have of a circle when the other has taken its part."""
    left = math.sqrt(max(room * room - taken * taken, 0.0))
    return -left, left


def _motion(vehicle: VehicleState | None) -> Motion | None:
    """None for a state that is none, or in which something is no number."""
    if vehicle is None:
        return None
    place, velocity, q = vehicle.position_w_m.tolist(), vehicle.velocity_w_mps.tolist(), vehicle.q_w_flu_wxyz
    if not math.isfinite(sum(place) + sum(velocity)) or not _is_rotation(q):
        return None
    return tuple(place), tuple(velocity), q


def _is_rotation(q: Array) -> bool:
    w, x, y, z = q.tolist()
    return bool(abs(w * w + x * x + y * y + z * z - 1.0) < 1e-3)


def _unusable(setpoint: AttitudeThrust) -> bool:
    return not (_is_rotation(setpoint.q_w_flu_wxyz) and math.isfinite(setpoint.thrust))


def _heading_rad(*setpoints: Any) -> float:
    """Of the first of them that has one; anything may come in."""
    for setpoint in setpoints:
        q = getattr(setpoint, "q_w_flu_wxyz", None)
        if isinstance(q, np.ndarray) and q.shape == (4,) and _is_rotation(q):
            return float(yaw_of(q))
    return 0.0
