"""Joint angles that bring a claw to a point: every way of one arm, and the one nearest to where it is."""

import math
from collections.abc import Mapping

import numpy as np

from companion.arms.model import CHAIN, JOINTS_PER_ARM, KINDS, SIDES, ArmModel, Side
from companion.core.interfaces import ArmError
from companion.core.types import Array

_ON_THE_EDGE = 1e-9
"""Rounding (share of a length) by which a point may lie beyond the reach."""


def ways_rad(model: ArmModel, side: Side, tip_flu_m: Array) -> Array:
    """Return all pitches and rolls that bring the tip to a point of body FLU (m): (n, 3), n up to 4.

    Joint limits are not asked. The roll alone moves the tip sideways, o L_3 sin r = y: two rolls, the second with the
    forearm folded back. What is left is a plane arm of L_1 and L_2 + L_3 cos r with the elbow on either side (Craig,
    Introduction to Robotics, section 4.4). Raises ArmError when the point is out of reach.
    """
    l1, l2, l3 = (link.length_m for link in model.links)
    x, y, z = (tip_flu_m - model.shoulders_flu_m()[SIDES.index(side)]).tolist()
    outward = y if side is Side.LEFT else -y
    if abs(outward) > l3 * (1.0 + _ON_THE_EDGE):
        raise ArmError(
            f"{_point(side, tip_flu_m)} is out of reach: {abs(outward):.3f} m to the side of the shoulder, "
            f"the elbow roll reaches {l3:.3f} m"
        )
    roll = math.asin(min(max(outward / l3, -1.0), 1.0))
    rolls = (roll, math.copysign(math.pi, roll) - roll)
    found = [(*bend, r) for r in rolls for bend in _plane_ways(l1, l2 + l3 * math.cos(r), x, z)]
    if not found:
        reach = l1 + abs(l2 + l3 * math.cos(roll))
        least = abs(l1 - abs(l2 + l3 * math.cos(roll)))
        raise ArmError(
            f"{_point(side, tip_flu_m)} is out of reach: {math.hypot(x, z):.3f} m from the shoulder's axis, "
            f"the arm reaches {least:.3f} to {reach:.3f} m so far to the side"
        )
    return np.unique(np.round(found, 12), axis=0)


def reach_rad(model: ArmModel, side: Side, tip_flu_m: Array, near_rad: Array) -> Array:
    """Return the solution within the joint limits nearest to `near_rad`, (3,); ArmError naming the joint if none."""
    ways = ways_rad(model, side, tip_flu_m)
    low, high = (limit[:CHAIN] for limit in model.limit_arrays()[:2])
    beyond = np.maximum(low - ways, ways - high)
    allowed = ways[(beyond <= _ON_THE_EDGE).all(axis=1)]
    if not len(allowed):
        best = int(np.argmin(beyond.max(axis=1)))
        joint = int(np.argmax(beyond[best]))
        raise ArmError(
            f"{_point(side, tip_flu_m)} cannot be reached: {side}.{KINDS[joint]} would have to be at "
            f"{ways[best, joint]:.3f} rad, allowed is {low[joint]:.3f} to {high[joint]:.3f} rad"
        )
    nearest = np.argmin(np.linalg.norm(allowed - near_rad, axis=1))
    return np.asarray(np.clip(allowed[nearest], low, high))


def reach_both_rad(model: ArmModel, tips_flu_m: Mapping[Side, Array], near_rad: Array) -> Array:
    """Return joints (8,) with the given tips at their points, nearest to `near_rad` (8,); others stay."""
    out = near_rad.copy()
    for side, tip in tips_flu_m.items():
        first = JOINTS_PER_ARM * SIDES.index(side)
        out[first : first + CHAIN] = reach_rad(model, side, tip, near_rad[first : first + CHAIN])
    return out


def _plane_ways(upper: float, lower: float, x: float, z: float) -> list[tuple[float, float]]:
    """Return both pitches of a plane arm (m) that end at x forward and z up of the shoulder; none out of reach."""
    if abs(lower) < _ON_THE_EDGE * upper:
        at_elbow = abs(math.hypot(x, z) - upper) <= _ON_THE_EDGE * upper
        return [(_turn(math.atan2(x, -z)), 0.0)] if at_elbow else []
    cosine = (x * x + z * z - upper * upper - lower * lower) / (2.0 * upper * lower)
    if abs(cosine) > 1.0 + _ON_THE_EDGE:
        return []
    elbow = math.acos(min(max(cosine, -1.0), 1.0))
    return [
        (_turn(math.atan2(x, -z) - math.atan2(lower * math.sin(b), upper + lower * math.cos(b))), b)
        for b in (elbow, -elbow)
    ]


def _turn(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)


def _point(side: Side, tip_flu_m: Array) -> str:
    x, y, z = tip_flu_m
    return f"the {side} tip's target ({x:.3f}, {y:.3f}, {z:.3f}) m"
