"""Distance of two vehicles' announced ways in space and time. Pure."""

from dataclasses import dataclass

import numpy as np

from companion.core.types import Array
from companion.trajectories.timed_path import TimedPath

_SLACKS_S = (0.0, -0.5, 0.5, -1.0, 1.0)
"""Times by which one of the two may be late or early: clocks of two computers, and a reference that waits."""
_SAMPLES = 800
_STILL_M = 1e-9
"""Motion along a straight piece below which it counts as none."""


@dataclass(frozen=True)
class Cylinder:
    """Space around a vehicle that no other enters: within `radius_m` horizontally and `height_m` vertically."""

    radius_m: float
    height_m: float


@dataclass(frozen=True)
class Meeting:
    """Nearest point of two ways, at the same time."""

    time_s: float
    position_w_m: Array
    """(3,): of the own vehicle."""
    distance_m: float
    """Horizontal distance there."""


@dataclass(frozen=True)
class Crossing:
    """Place that both come through at different times."""

    position_w_m: Array
    """(3,): of the own vehicle."""
    after_s: float
    """Time from the other's passage to the own one; negative when the own vehicle is first."""


def meeting(own: TimedPath, other: TimedPath, cylinder: Cylinder) -> Meeting | None:
    """Return the nearest point at which `own` is inside the other's cylinder; None where it never is.

    One of the two may be up to 1 s early or late. Exact for paths that are straight between knots.
    """
    found = [_nearest(own, other.later(slack_s), cylinder) for slack_s in _SLACKS_S]
    return min((one for one in found if one is not None), key=lambda one: one.distance_m, default=None)


def _nearest(own: TimedPath, other: TimedPath, cylinder: Cylinder) -> Meeting | None:
    begin_s = own.times_s[0]
    knots_s = np.concatenate([own.times_s, other.times_s])
    end_s = knots_s.max() + 1.0  # after which both stand still
    times_s = np.unique(np.append(knots_s[knots_s >= begin_s], end_s))
    apart = own.at(times_s) - other.at(times_s)
    start, way = apart[:-1], np.diff(apart, axis=0)
    first, last = _low(start[:, 2], way[:, 2], cylinder.height_m)
    length_2 = np.sum(way[:, :2] ** 2, axis=1)
    toward = -np.sum(start[:, :2] * way[:, :2], axis=1)
    share = np.clip(np.divide(toward, length_2, out=np.zeros_like(toward), where=length_2 > _STILL_M**2), first, last)
    distance_m = np.linalg.norm(start[:, :2] + share[:, None] * way[:, :2], axis=1)
    distance_m[first > last] = np.inf
    least = int(np.argmin(distance_m))
    if distance_m[least] >= cylinder.radius_m:
        return None
    time_s = float(times_s[least] + share[least] * (times_s[least + 1] - times_s[least]))
    return Meeting(time_s, own.at(np.array([time_s]))[0], float(distance_m[least]))


def _low(start_m: Array, way_m: Array, height_m: float) -> tuple[Array, Array]:
    """Return first and last share of each straight piece in which the height difference is below `height_m`.

    The first is above the last where there is none.
    """
    moving = np.abs(way_m) > _STILL_M
    slope_m = np.where(moving, way_m, 1.0)
    one, two = (-height_m - start_m) / slope_m, (height_m - start_m) / slope_m
    always = np.abs(start_m) < height_m
    first = np.where(moving, np.maximum(np.minimum(one, two), 0.0), np.where(always, 0.0, 1.0))
    last = np.where(moving, np.minimum(np.maximum(one, two), 1.0), np.where(always, 1.0, 0.0))
    return first, last


def crossing(own: TimedPath, other: TimedPath, cylinder: Cylinder) -> Crossing | None:
    """Return the place where `own` is inside the other's cylinder at another time, the one least apart in time."""
    own_s, other_s = (np.linspace(path.times_s[0], path.times_s[-1], _SAMPLES) for path in (own, other))
    ours, theirs = own.at(own_s), other.at(other_s)
    apart = ours[:, None, :] - theirs[None, :, :]
    near = (np.hypot(apart[..., 0], apart[..., 1]) < cylinder.radius_m) & (np.abs(apart[..., 2]) < cylinder.height_m)
    if not near.any():
        return None
    after_s = own_s[:, None] - other_s[None, :]
    index = int(np.argmin(np.where(near, np.abs(after_s), np.inf)))
    mine, _ = np.unravel_index(index, near.shape)
    return Crossing(ours[mine], float(after_s.flat[index]))
