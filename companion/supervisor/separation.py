"""Paths of this vehicle and of the others over the next seconds, and where they come too near. Pure, floats."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from companion.core.types import OtherVehicle, Vec3
from companion.guard.separation import Separation

STEP_S = 0.25
"""Time between two points of a path; in between it is taken as straight."""
NEARER_M = 0.05
"""Decrease of the distance that counts as coming nearer; less is noise."""
_STANDS_MPS = 0.2
"""Speed below which a vehicle is taken to stay where it is."""


@dataclass(frozen=True, kw_only=True)
class SeparationRules:
    """Cylinder around other vehicles, and who of them goes first."""

    cylinder: Separation
    first: frozenset[str] = frozenset()
    """Bodies of the vehicles that this one yields to."""

    def yields_to(self, other: OtherVehicle) -> bool:
        """Return True if this vehicle gives way: by the order, and to everything that cannot."""
        return other.body in self.first or other.parked


def ahead_of(other: OtherVehicle, after_s: float) -> Vec3:
    """Return the position (m) of another vehicle that goes on as it moves now."""
    (x, y, z), (vx, vy, vz) = other.position_w_m, other.velocity_w_mps
    return x + vx * after_s, y + vy * after_s, z + vz * after_s


def stopped(other: OtherVehicle, cylinder: Separation) -> Vec3:
    """Return where another vehicle comes to rest (m) if it brakes now, by the guard's rule."""
    speed_mps = math.hypot(*other.velocity_w_mps)
    return ahead_of(other, cylinder.stop_m(speed_mps) / speed_mps) if speed_mps > 0.0 else other.position_w_m


def least_gap_m(path_w_m: Sequence[Vec3], other: OtherVehicle, cylinder: Separation) -> float:
    """Return the least distance (m) to the other's cylinder along a path, a point every STEP_S; negative inside it.

    The other goes on as it moves now.
    """
    points = [(point, ahead_of(other, index * STEP_S)) for index, point in enumerate(path_w_m)]
    halves = [(_half(a, b), _half(c, d)) for (a, c), (b, d) in pairwise(points)]
    return min(_gap_m(at, there, other, cylinder) for at, there in (*points, *halves))


def stopping_path(position_w_m: Vec3, velocity_w_mps: Vec3, cylinder: Separation, for_s: float) -> tuple[Vec3, ...]:
    """Return the path (m) of a vehicle that brakes now, a point every STEP_S."""
    (x, y, z), (vx, vy, vz) = position_w_m, velocity_w_mps
    stop_s = 2.0 * cylinder.reaction_s + math.hypot(vx, vy, vz) / cylinder.braking_mps2
    points = []
    for index in range(round(for_s / STEP_S) + 1):
        t = min(index * STEP_S, stop_s)
        flown_s = t - 0.5 * t * t / stop_s
        points.append((x + vx * flown_s, y + vy * flown_s, z + vz * flown_s))
    return tuple(points)


def objection(
    path_w_m: Sequence[Vec3], step_s: float, others: Iterable[OtherVehicle], cylinder: Separation, ahead_s: float
) -> str:
    """Return why a path, a point every `step_s`, may not be flown for another vehicle; empty if it may.

    One that stands is taken to stay, one that moves to go on for `ahead_s`; leaving the cylinder is no objection.
    """
    return next(filter(None, (_objection(path_w_m, step_s, one, cylinder, ahead_s) for one in others if one.known)), "")


def _objection(
    path_w_m: Sequence[Vec3], step_s: float, other: OtherVehicle, cylinder: Separation, ahead_s: float
) -> str:
    moves = math.hypot(*other.velocity_w_mps) > _STANDS_MPS
    looked_at = path_w_m[: int(ahead_s / step_s) + 1] if moves else path_w_m
    ways = [(point, ahead_of(other, index * step_s if moves else 0.0)) for index, point in enumerate(looked_at)]
    gaps_m = [_gap_m(point, there, other, cylinder) for point, there in ways]
    least_m = min(gaps_m)
    if not least_m < 0.0 or not (least_m < gaps_m[0] - NEARER_M or gaps_m[-1] < 0.0):
        return ""
    point, there = ways[gaps_m.index(least_m)]
    state = "stands" if other.parked else "flies"
    return (
        f"this way leads within {math.dist(point[:2], there[:2]):.2f} m of {other.body!r}, which {state} at "
        f"{there[0]:.1f} {there[1]:.1f} {there[2]:.1f}; at least {cylinder.radius_m:.2f} m are needed: keep away "
        "from it, or wait until it is gone"
    )


def _half(a: Vec3, b: Vec3) -> Vec3:
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


def _gap_m(position_w_m: Vec3, there_w_m: Vec3, other: OtherVehicle, cylinder: Separation) -> float:
    return cylinder.gap_between_m(position_w_m, there_w_m, other.parked)
