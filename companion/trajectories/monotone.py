"""Monotone quintic spline: derivatives at each point for a curve that does not overshoot between the points."""

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array

_MOST_SLOPE = 1.25
"""Largest slope at a point relative to the mean slopes beside it: up to here a quintic stays monotone, see below."""


def monotone_motion_at_knots(spans: Array, steps: Array) -> Array:
    """Return first and second derivative (n, 2) at n points that are `spans` (s) and `steps`, each (n - 1,), apart.

    At rest at both ends. The quintic that meets them in each segment stays between the segment's two points, and stands
    still where they are equal. Slopes: Fritsch and Butland, 1984 (PCHIP). Curvatures: those of the parabola through a
    point and its neighbours, held in by Dougherty, Edelman and Hyman, 1989 (monotone quintics).
    """
    slopes = steps / spans
    motion = np.zeros((len(spans) + 1, 2))
    same_way = slopes[:-1] * slopes[1:] > 0.0
    if not len(same_way):
        return motion
    motion[1:-1, 0] = _pchip_slopes(spans, slopes, same_way)
    bend = 2.0 * np.diff(slopes) / (spans[:-1] + spans[1:])
    low, high = _curvature_bounds(spans, slopes, motion[1:-1, 0])
    motion[1:-1, 1] = np.clip(bend, low, high)
    return motion


def _pchip_slopes(spans: Array, slopes: Array, same_way: NDArray[np.bool_]) -> Array:
    """Return weighted harmonic means of both sides' slopes, at most _MOST_SLOPE of either; 0 where the signs differ."""
    before, after = spans[:-1], spans[1:]
    w_before, w_after = 2.0 * after + before, after + 2.0 * before
    left, right = np.where(same_way, slopes[:-1], 1.0), np.where(same_way, slopes[1:], 1.0)
    mean = (w_before + w_after) / (w_before / left + w_after / right)
    most = _MOST_SLOPE * np.minimum(np.abs(left), np.abs(right))
    return np.where(same_way, np.clip(mean, -most, most), 0.0)


def _curvature_bounds(spans: Array, slopes: Array, speeds: Array) -> tuple[Array, Array]:
    """Return least and largest second derivative at the inner points with which both segments beside one stay monotone.

    With step 1 and span 1, speeds a, b and second derivatives A, B at the ends, the quintic's derivative has the
    Bernstein coefficients a, a + A/4, 5 - 2a - 2b - A/4 + B/4, b - B/4, b. None is negative if a, b <= 1.25,
    -4a <= A <= 10 - 8a and 8b - 10 <= B <= 4b. Where a step is 0, A = B = 0.
    """
    after = _ends(4.0 * speeds, 10.0 * slopes[1:] - 8.0 * speeds, spans[1:])
    before = _ends(10.0 * slopes[:-1] - 8.0 * speeds, 4.0 * speeds, spans[:-1])
    return np.maximum(after[0], before[0]), np.minimum(after[1], before[1])


def _ends(down: Array, up: Array, spans: Array) -> tuple[Array, Array]:
    """Return -`down` and `up` of a rising segment, in this order; of a falling one both have the other sign."""
    return np.minimum(-down, up) / spans, np.maximum(-down, up) / spans
