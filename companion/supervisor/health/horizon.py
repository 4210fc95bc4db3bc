"""Test of the autopilot's horizon against the vehicle's motion, when motion capture disagrees on the tilt. Pure.

Apart from gravity, only the rotors accelerate the vehicle for long, along its up axis: the specific force lies along
the true up axis. Only its direction is used, so that mass, thrust and battery do not matter. A disturbance of 5 N on a
vehicle of 5 kg turns it by 0.1 rad.
"""

from math import atan2, exp, hypot

from companion.core.paper_vehicle import GRAVITY_MPS2
from companion.core.types import Array, Vec3
from companion.core.values import value

AVERAGED_S = 0.15
"""Time constant of the means: the velocity's noise (0.014 m/s) makes 0.1 m/s^2, a hundredth of a radian."""
NEARER = 0.4
"""Largest angle between force and motion capture's axis for a wrong autopilot, as a share of the axes' angle."""
_LEAST_PUSH_MPS2 = 4.0
"""Least specific force whose direction is used: in near free fall it is noise."""

_NOWHERE = (0.0, 0.0, 0.0)


@value
class MotionMeans:
    """Exponential means with one common weighting, at the time of a capture; in W."""

    at_s: float
    velocity_mps: Vec3
    force_mps2: Vec3 = _NOWHERE
    """Specific force; too short until AVERAGED_S has passed a few times."""
    ours: Vec3 = _NOWHERE
    """Up axis by motion capture."""
    theirs: Vec3 = _NOWHERE
    """Up axis by the autopilot."""


def update_means(
    before: MotionMeans | None, at_s: float, velocity_w_mps: Array, ours: Vec3, theirs: Vec3
) -> MotionMeans:
    """Update the means with a capture at `at_s`; `ours` and `theirs` are up axes in W. None starts new means."""
    vx, vy, vz = velocity_w_mps.tolist()
    if before is None:
        return MotionMeans(at_s, (vx, vy, vz))
    passed_s = at_s - before.at_s
    if not passed_s > 0.0:
        return before
    wx, wy, wz = before.velocity_mps
    force = (vx - wx) / passed_s, (vy - wy) / passed_s, (vz - wz) / passed_s + GRAVITY_MPS2
    left = exp(-passed_s / AVERAGED_S)
    return MotionMeans(
        at_s,
        (vx, vy, vz),
        _mean(before.force_mps2, force, left),
        _mean(before.ours, ours, left),
        _mean(before.theirs, theirs, left),
    )


def autopilot_horizon_wrong(means: MotionMeans | None) -> bool:
    """Return true if the motion clearly fits motion capture's tilt and not the autopilot's; false in doubt."""
    if means is None or not hypot(*means.force_mps2) > _LEAST_PUSH_MPS2:
        return False
    return angle_between_rad(means.force_mps2, means.ours) < NEARER * angle_between_rad(means.ours, means.theirs)


def angle_between_rad(a: Vec3, b: Vec3) -> float:
    """Return the angle between two directions, rad; NaN if one of them contains NaN."""
    (ax, ay, az), (bx, by, bz) = a, b
    return atan2(hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), ax * bx + ay * by + az * bz)


def _mean(before: Vec3, now: Vec3, left: float) -> Vec3:
    (ax, ay, az), (bx, by, bz), new = before, now, 1.0 - left
    return left * ax + new * bx, left * ay + new * by, left * az + new * bz
