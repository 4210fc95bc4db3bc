"""Whose horizon is right when motion capture and autopilot disagree on the tilt: the vehicle's motion tells. Pure.

Rotors push along the vehicle's up axis and nothing else does for long, so what gravity does not explain of the motion,
the specific force, lies along the true up axis. Only its direction is looked at: neither mass nor thrust need be known,
and a weak battery changes nothing. A push of 5 N, on a vehicle of 5 kg, turns it by 0.1 rad.
"""

from math import atan2, exp, hypot

from companion.core.types import Array
from companion.core.values import value

AVERAGED_S = 0.15
"""Time constant of the means: the velocity's noise (0.014 m/s) makes 0.1 m/s^2, a hundredth of a radian."""
NEARER = 0.4
"""Share of the angle between the two up axes that the force may be off motion capture's, and the autopilot lies."""
_LEAST_PUSH_MPS2 = 4.0
"""A vehicle that nearly falls pushes too little for the direction to mean anything."""
_GRAVITY_MPS2 = 9.8

Axis = tuple[float, float, float]
_NOWHERE = (0.0, 0.0, 0.0)


@value
class Pushed:
    """Means of the last time, all weighted alike, as of a capture; in W."""

    at_s: float
    velocity_mps: Axis
    force_mps2: Axis = _NOWHERE
    """Specific force, shorter than it is until AVERAGED_S has passed a few times."""
    ours: Axis = _NOWHERE
    """Up axis by motion capture."""
    theirs: Axis = _NOWHERE
    """Up axis by the autopilot."""


def pushed_on(before: Pushed | None, at_s: float, velocity_w_mps: Array, ours: Axis, theirs: Axis) -> Pushed:
    """One capture at `at_s` more; `ours` and `theirs` are up axes in W. None begins anew."""
    vx, vy, vz = velocity_w_mps.tolist()
    if before is None:
        return Pushed(at_s, (vx, vy, vz))
    passed_s = at_s - before.at_s
    if not passed_s > 0.0:
        return before
    wx, wy, wz = before.velocity_mps
    force = (vx - wx) / passed_s, (vy - wy) / passed_s, (vz - wz) / passed_s + _GRAVITY_MPS2
    left = exp(-passed_s / AVERAGED_S)
    return Pushed(
        at_s,
        (vx, vy, vz),
        _mean(before.force_mps2, force, left),
        _mean(before.ours, ours, left),
        _mean(before.theirs, theirs, left),
    )


def autopilot_lies(pushed: Pushed | None) -> bool:
    """Whether the motion is motion capture's, and clearly not the autopilot's. False when nobody can tell."""
    if pushed is None or not hypot(*pushed.force_mps2) > _LEAST_PUSH_MPS2:
        return False
    return between_rad(pushed.force_mps2, pushed.ours) < NEARER * between_rad(pushed.ours, pushed.theirs)


def between_rad(a: Axis, b: Axis) -> float:
    """Angle between two directions; NaN if there is one in it."""
    (ax, ay, az), (bx, by, bz) = a, b
    return atan2(hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), ax * bx + ay * by + az * bz)


def _mean(before: Axis, now: Axis, left: float) -> Axis:
    (ax, ay, az), (bx, by, bz), new = before, now, 1.0 - left
    return left * ax + new * bx, left * ay + new * by, left * az + new * bz
