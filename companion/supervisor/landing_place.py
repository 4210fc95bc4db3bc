"""Place beside other vehicles to land at, for a vehicle that is above one. Pure, floats."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from companion.core.types import OtherVehicle, Vec3
from companion.guard.geofence import Fence
from companion.guard.separation import Separation

_DIRECTIONS = 24
"""Directions from another vehicle that are tried: 15 degrees apart."""
_BELOW = 0.5
"""Share of the cylinder's height from which on the guard keeps two apart by their heights, and stops a descent."""
_SPARE_M = 0.05
"""Distance beyond the cylinder, so that rounding and noise do not begin the search again."""


def landing_place(
    here_w_m: Vec3, others: Iterable[OtherVehicle], cylinder: Separation, fence: Fence, inside_m: float
) -> Vec3:
    """Return the nearest place at this height whose way down no other vehicle is in; this one if there is none.

    It is `inside_m` inside the fence. Only one that is well below makes it look for another place; one that is not is
    passed on the way down, beside it. A place where it would not be passed is taken only if there is no other.
    """
    known = [other for other in others if other.known]
    below = [other for other in known if _is_below(here_w_m, other, cylinder)]
    if _clear(here_w_m, below, cylinder):
        return here_w_m
    beside = [other for other in known if other.position_w_m[2] - here_w_m[2] < cylinder.height_m]
    places = [place for place in _around(here_w_m, beside, cylinder) if _clear(place, below, cylinder)]
    inside = [place for place in places if fence.beyond_m(np.array(place)) <= -inside_m]
    free = [place for place in inside if _clear(place, beside, cylinder)]
    return min(free or inside, key=lambda place: math.dist(place, here_w_m), default=here_w_m)


def _is_below(here: Vec3, other: OtherVehicle, cylinder: Separation) -> bool:
    return here[2] - other.position_w_m[2] > _BELOW * cylinder.height_over_m(other.parked)


def _clear(place: Vec3, others: Sequence[OtherVehicle], cylinder: Separation) -> bool:
    return all(_apart_m(place, other) >= cylinder.radius_m for other in others)


def _apart_m(place: Vec3, other: OtherVehicle) -> float:
    return math.hypot(place[0] - other.position_w_m[0], place[1] - other.position_w_m[1])


def _around(here: Vec3, others: Sequence[OtherVehicle], cylinder: Separation) -> Iterator[Vec3]:
    """Yield places around each of the others, the first one straight away from it."""
    radius_m = cylinder.radius_m + _SPARE_M
    for other in others:
        x, y, _ = other.position_w_m
        away_rad = math.atan2(here[1] - y, here[0] - x)
        for index in range(_DIRECTIONS):
            angle_rad = away_rad + math.tau * index / _DIRECTIONS
            yield x + radius_m * math.cos(angle_rad), y + radius_m * math.sin(angle_rad), here[2]
