"""Guard in front of the autopilot: limits every setpoint by limits, age of the state, geofence and other vehicles.

It depends on neither controller nor supervisor and trusts neither: it uses the commanded setpoint, the last one sent,
and the state the command was computed from. Pure, single vehicle, plain floats.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.core.types import Array, AttitudeThrust, OtherVehicle, Vec3, VehicleState
from companion.geometry.attitude import ThrustModel, collective_force_n, limit_tilt, setpoint_of_accel
from companion.geometry.frames import quat_from_yaw, yaw_of
from companion.guard.geofence import Allowed, Fence, Range
from companion.guard.limits import LimitedSetpoint, Limits, inside_cone, limit_setpoint
from companion.guard.separation import NO_WALLS, Separation, Walls

SINKING = 0.97
"""Share of hover thrust with which the vehicle descends gently while it is not controlled."""
_INSET_M = 0.05
"""Margin inside the fence for errors of the predicted response of the vehicle."""
_SHORTEST_S = 1e-3
"""Least time step; with a clock that stands still, a step of 0 would hold a tilt for ever."""
_LEAST_PUSH = 0.5
"""Share of the weight that the rotors keep carrying below a ceiling, as braking sideways needs thrust."""
_YES = np.array(True)

_CORNER_ROUNDS = 8
"""Rounds in which fence and other vehicles are reconciled: each halves what is left at the sharpest corner."""

Quat = Sequence[float]
"""Attitude as four floats."""
FloatSetpoint = Sequence[float]
"""Attitude and thrust as five floats."""
Motion = tuple[Vec3, Vec3, Array, tuple[OtherVehicle, ...]]
"""Position (m), velocity (m/s), attitude, the other vehicles."""
Near = tuple[Allowed, Walls, Array]
"""Accelerations that fence and other vehicles allow, and the vehicle's attitude."""


@dataclass(frozen=True)
class Braked:
    """Setpoint that brakes, and what for."""

    setpoint: AttitudeThrust
    fence: bool = False
    separation: bool = False


def most_braking_mps2(limits: Limits, model: ThrustModel) -> tuple[float, float]:
    """Return the largest deceleration (m/s^2) that the guard commands sideways, at hover, and while climbing.

    A fence may assume no more. While climbing, the rotors keep half the weight, or the force of the least thrust if
    that is more.
    """
    kept_mps2 = max(_LEAST_PUSH * model.gravity_mps2, collective_force_n(limits.min_thrust, model) / model.mass_kg)
    return model.gravity_mps2 * math.tan(limits.max_tilt_rad), model.gravity_mps2 - kept_mps2


@dataclass(frozen=True)
class AgeRange:
    """Ages between which a setpoint is blended to level."""

    coast_s: float
    """Up to this age nothing is done."""
    level_s: float
    """From this age on the vehicle is level."""

    def share(self, age_s: float) -> float:
        """Return 1 while fresh, 0 when too old or if the age is NaN; a clock may err either way."""
        if abs(age_s) <= self.coast_s:
            return 1.0
        if abs(age_s) < self.level_s:
            return (self.level_s - abs(age_s)) / (self.level_s - self.coast_s)
        return 0.0


NO_AGE_LIMIT = AgeRange(math.inf, math.inf)
"""For commands of a law on board."""


class Guard:
    """Limiter of setpoints. It is stateless and never raises.

    A state up to `coast_s` old changes nothing. Up to `degraded_s` the tilt cone shrinks to zero and the thrust is
    blended to just below hover. With an older state or none, the vehicle is levelled and sinks gently whatever is
    commanded, and the fence is not applied, as the position is unknown.

    Towards a face of the fence the acceleration is limited so that the vehicle can stop 5 cm before it
    (Fence.allowed_accel_w_mps2). The other axes keep their command within the tilt cone, where braking has priority.
    If the command is to fall, the thrust is raised as far as braking sideways needs, and at most to hover. Below a
    ceiling the rotors keep half the weight. While the vehicle brakes, its present heading is kept.

    Towards another vehicle it is limited in the same way, so that both can stop 5 cm before the cylinder between them
    (Separation.walls). Where no acceleration keeps away from both, the fence counts.

    A flight within the limits passes unchanged to the last bit: speeds towards a face for which the table in Fence
    leaves room, 2.5 m/s^2 towards a face half a metre away from rest, and any speed along a face; with other vehicles
    in the room, as long as both could still stop.
    """

    def __init__(
        self,
        limits: Limits,
        model: ThrustModel,
        fence: Fence,
        pose: AgeRange,
        command: AgeRange = NO_AGE_LIMIT,
        separation: Separation | None = None,
    ) -> None:
        self._limits, self._model, self._pose_ages, self._command_ages = limits, model, pose, command
        (x0, y0), (x1, y1, z1) = fence.low_m, fence.high_m
        inner = (x0 + _INSET_M, y0 + _INSET_M), (x1 - _INSET_M, y1 - _INSET_M, z1 - _INSET_M)
        self._fence = replace(fence, low_m=inner[0], high_m=inner[1])
        self._separation = None if separation is None else separation.widened(_INSET_M)
        self._slope, self._upright = math.tan(limits.max_tilt_rad), math.cos(limits.max_tilt_rad)

    def check(
        self,
        setpoint: AttitudeThrust,
        last: AttitudeThrust,
        vehicle: VehicleState | None,
        age_s: float,
        dt_s: float,
        command_age_s: float = 0.0,
    ) -> LimitedSetpoint:
        """Return the setpoint to send instead of `setpoint`, `dt_s` after `last`: always finite and inside the limits.

        `vehicle` is the state that `setpoint` was computed from, None when there is none; `age_s` is the time since its
        capture. `command_age_s` is the time since a law elsewhere has confirmed the command, 0 for a law on board.
        """
        try:
            known = min(self._pose_ages.share(age_s), self._command_ages.share(command_age_s))
            return self._checked(setpoint, last, vehicle, known, dt_s if dt_s > _SHORTEST_S else _SHORTEST_S)
        except Exception as error:  # any error: no setpoint is sent unguarded
            return LimitedSetpoint(
                setpoint=self.level(_heading_rad(last, setpoint)),
                not_finite=_YES,
                tilt_cut=_YES,
                thrust_cut=_YES,
                slew_cut=_YES,
                age_cut=_YES,
                fence_cut=_YES,
                separation_cut=_YES,
                failure=f"{type(error).__name__}: {error}",
            )

    def passes(
        self, setpoint: FloatSetpoint, last: AttitudeThrust, vehicle: VehicleState | None, age_s: float, dt_s: float
    ) -> bool:
        """Return True if `check` of a command of this cycle only applies `limit_setpoint`; False in doubt.

        The same verdict, with every number taken from its array once: it stands between frame and setpoint.
        """
        try:
            if vehicle is None or not dt_s > _SHORTEST_S:
                return False
            if self._pose_ages.share(age_s) != 1.0 or self._command_ages.share(0.0) != 1.0:
                return False
            position, velocity = vehicle.position_w_m.tolist(), vehicle.velocity_w_mps.tolist()
            now, before, wanted = vehicle.q_w_flu_wxyz.tolist(), last.q_w_flu_wxyz.tolist(), setpoint[:4]
            thrust, push = setpoint[4], last.thrust.item()
            if not (_has_unit_length(now) and _has_unit_length(before) and _has_unit_length(wanted)):
                return False
            if not math.isfinite(sum(position) + sum(velocity) + push):
                return False
            allowed, walls = self._allowed_at(position, velocity, (now, before), push, vehicle.others)
            return self._is_inside(wanted, thrust, allowed, walls)
        except Exception:  # `check` will tell
            return False

    def level(self, yaw_rad: float) -> AttitudeThrust:
        """Return a level setpoint at this heading that sinks gently."""
        return AttitudeThrust(quat_from_yaw(yaw_rad), np.array(SINKING * self._model.hover_thrust))

    def _checked(
        self, setpoint: AttitudeThrust, last: AttitudeThrust, vehicle: VehicleState | None, known: float, dt_s: float
    ) -> LimitedSetpoint:
        if _is_invalid(last):
            last = self.level(_heading_rad(setpoint))
        motion = _motion(vehicle)
        if motion is None or known == 0.0:
            return self._limited(setpoint, last, dt_s, None, 0.0)
        allowed, walls = self._allowed(motion, last)
        if known == 1.0 and self._passes(setpoint, allowed, walls):
            return limit_setpoint(setpoint, last, self._limits, dt_s)
        return self._limited(setpoint, last, dt_s, (allowed, walls, motion[2]), known)

    def _limited(
        self, setpoint: AttitudeThrust, last: AttitudeThrust, dt_s: float, near: Near | None, known: float
    ) -> LimitedSetpoint:
        """Limit tilt and thrust first, so that braking starts from what would be sent; then limit the rates."""
        within = limit_setpoint(setpoint, last, self._limits, math.inf)
        braked = Braked(within.setpoint) if near is None else self._braked(within.setpoint, near)
        target = braked.setpoint if known == 1.0 else self._levelled(braked.setpoint, known)
        if target is within.setpoint:
            return limit_setpoint(setpoint, last, self._limits, dt_s)
        out = limit_setpoint(target, last, self._limits, dt_s)
        return replace(
            out,
            not_finite=within.not_finite,
            tilt_cut=np.asarray(within.tilt_cut | out.tilt_cut),
            thrust_cut=np.asarray(within.thrust_cut | out.thrust_cut),
            age_cut=np.array(known < 1.0),
            fence_cut=np.array(braked.fence),
            separation_cut=np.array(braked.separation),
        )

    def _accel(self, q: Quat, thrust: float) -> Vec3:
        """Return the acceleration (m/s^2) of a setpoint in floats; see attitude.accel_of_setpoint."""
        push = collective_force_n(thrust, self._model) / self._model.mass_kg
        w, x, y, z = q
        up = 1 - 2 * (x * x + y * y)
        return push * (2 * (x * z + w * y)), push * (2 * (y * z - w * x)), push * up - self._model.gravity_mps2

    def _allowed(self, motion: Motion, last: AttitudeThrust) -> tuple[Allowed, Walls]:
        position, velocity, q, others = motion
        return self._allowed_at(
            position, velocity, (q.tolist(), last.q_w_flu_wxyz.tolist()), float(last.thrust), others
        )

    def _allowed_at(
        self,
        position: Vec3,
        velocity: Vec3,
        attitudes: tuple[Quat, Quat],
        thrust: float,
        others: tuple[OtherVehicle, ...],
    ) -> tuple[Allowed, Walls]:
        """Return what fence and others allow; what acts now is the mean of present attitude and last setpoint."""
        now, next_ = self._accel(attitudes[0], thrust), self._accel(attitudes[1], thrust)
        acting = 0.5 * (now[0] + next_[0]), 0.5 * (now[1] + next_[1]), 0.5 * (now[2] + next_[2])
        allowed = self._fence.allowed_accel_w_mps2(position, velocity, acting)
        if self._separation is None or not others:
            return allowed, NO_WALLS
        return allowed, self._separation.walls(position, velocity, acting, others)

    def _passes(self, setpoint: AttitudeThrust, allowed: Allowed, walls: Walls) -> bool:
        """Return True for a setpoint inside all limits, by a quick check; False for one that is not finite."""
        q = setpoint.q_w_flu_wxyz.tolist()
        return _has_unit_length(q) and self._is_inside(q, float(setpoint.thrust), allowed, walls)

    def _is_inside(self, q: Quat, thrust: float, allowed: Allowed, walls: Walls) -> bool:
        x, y, z = self._accel(q, thrust)
        (x0, x1), (y0, y1), (_, z1) = allowed
        inside = x0 <= x <= x1 and y0 <= y <= y1 and z <= z1 and (walls is NO_WALLS or walls.let((x, y, z)))
        upright = 1 - 2 * (q[1] * q[1] + q[2] * q[2]) >= self._upright
        return inside and upright and self._limits.min_thrust <= thrust <= self._limits.max_thrust

    def _braked(self, setpoint: AttitudeThrust, near: Near) -> Braked:
        """Return `setpoint` itself if fence and others allow it, else the nearest setpoint that brakes.

        It keeps the present heading: turning would take time of the attitude loop that braking needs.
        """
        allowed, walls, now_q = near
        gravity = self._model.gravity_mps2
        x, y, z = self._accel(setpoint.q_w_flu_wxyz.tolist(), float(setpoint.thrust))
        apart, (bx, by, bz) = self._kept_inside((x, y, z), allowed, walls)
        if (bx, by, bz) == (x, y, z):
            return Braked(setpoint)
        separation, fence = apart != (x, y, z), (bx, by, bz) != apart
        brake = math.hypot(bx if bx != x else 0.0, by if by != y else 0.0)
        if bz == z:
            bz = max(z, min(brake / self._slope - gravity, 0.0))
        room = self._slope * (bz + gravity)
        if separation and not fence:
            bx, by = walls.tangent_first(bx, by, room)
        elif bx != x and by == y:
            by = _clipped(by, _around(room, bx), room)
        elif by != y and bx == x:
            bx = _clipped(bx, _around(room, by), room)
        accel = limit_tilt(np.array((bx, by, bz)), self._limits.max_tilt_rad, gravity)
        return Braked(setpoint_of_accel(accel, float(yaw_of(now_q)), self._model), fence, separation)

    def _kept_inside(self, accel: Vec3, allowed: Allowed, walls: Walls) -> tuple[Vec3, Vec3]:
        """Return an acceleration behind the walls alone, and one that is inside the fence, too."""
        gravity = self._model.gravity_mps2
        full, upwards = gravity * self._slope, (1.0 - _LEAST_PUSH) * gravity
        x, y, z = accel
        if walls is not NO_WALLS:
            x, y = walls.behind(x, y, full)
            z = _clipped(z, (walls.least_up_mps2, walls.most_up_mps2), upwards)
        bx, by, bz = _clipped(x, allowed[0], full), _clipped(y, allowed[1], full), _clipped(z, allowed[2], upwards)
        if walls.sideways and (bx, by) != (x, y):
            for _ in range(_CORNER_ROUNDS):
                bx, by = walls.behind(bx, by, full)
                bx, by = _clipped(bx, allowed[0], full), _clipped(by, allowed[1], full)
        return (x, y, z), (bx, by, bz)

    def _levelled(self, setpoint: AttitudeThrust, known: float) -> AttitudeThrust:
        """Blend to level and sinking gently as `known` goes from 1 to 0."""
        q, _ = inside_cone(setpoint.q_w_flu_wxyz, known * self._limits.max_tilt_rad)
        thrust, sinking = float(setpoint.thrust), SINKING * self._model.hover_thrust
        return AttitudeThrust(q, np.array(known * thrust + (1.0 - known) * sinking))


def _clipped(accel_mps2: float, allowed: Range, full_mps2: float) -> float:
    """Return the acceleration inside the allowed range, but changed to no more than `full`."""
    low, high = min(allowed[0], full_mps2), max(allowed[1], -full_mps2)
    return max(low, min(high, accel_mps2))


def _around(room: float, taken: float) -> Range:
    """Return the range left for one axis inside a circle when the other axis uses `taken` of its radius."""
    left = math.sqrt(max(room * room - taken * taken, 0.0))
    return -left, left


def _motion(vehicle: VehicleState | None) -> Motion | None:
    """Return position, velocity, attitude and the others; None without a state, or if any of them is not valid."""
    if vehicle is None:
        return None
    position, velocity, q = vehicle.position_w_m.tolist(), vehicle.velocity_w_mps.tolist(), vehicle.q_w_flu_wxyz
    if not math.isfinite(sum(position) + sum(velocity)) or not _is_rotation(q):
        return None
    return tuple(position), tuple(velocity), q, vehicle.others


def _is_rotation(q: Array) -> bool:
    return _has_unit_length(q.tolist())


def _has_unit_length(q: Quat) -> bool:
    w, x, y, z = q
    return abs(w * w + x * x + y * y + z * z - 1.0) < 1e-3


def _is_invalid(setpoint: AttitudeThrust) -> bool:
    return not (_is_rotation(setpoint.q_w_flu_wxyz) and math.isfinite(setpoint.thrust))


def _heading_rad(*setpoints: object) -> float:
    """Return the heading (rad) of the first valid setpoint, 0 without one; accepts any object."""
    for setpoint in setpoints:
        q = getattr(setpoint, "q_w_flu_wxyz", None)
        if isinstance(q, np.ndarray) and q.shape == (4,) and _is_rotation(q):
            return float(yaw_of(q))
    return 0.0
