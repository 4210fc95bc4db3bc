"""Positions over time with straight lines between knots: what one vehicle tells another of its way. Pure."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from companion.core.types import Array

_STEP_S = 0.1
_MOST_SAMPLES = 4000
_TOLERANCE_M = 0.02
"""Largest distance of the path from the lines between its knots: far below any separation."""


@dataclass(frozen=True)
class TimedPath:
    """Path from knot to knot; before the first knot and after the last one it stands still."""

    times_s: Array
    """(n,), increasing."""
    positions_w_m: Array
    """(n, 3) in W."""

    def at(self, times_s: Array) -> Array:
        """Return the positions (m, 3) at times (m,)."""
        return np.stack([np.interp(times_s, self.times_s, axis) for axis in self.positions_w_m.T], axis=-1)

    def later(self, by_s: float) -> "TimedPath":
        """Return the same path, flown `by_s` later."""
        return TimedPath(self.times_s + by_s, self.positions_w_m)


def sampled(position_w_m: Callable[[float], Array], duration_s: float, most_knots: int) -> TimedPath:
    """Return the path of a function of time from 0 to `duration_s`, in at most `most_knots` knots.

    It is within 2 cm of the function at every sample, or as near as that number of knots allows.
    """
    count = min(_MOST_SAMPLES, max(2, int(duration_s / _STEP_S) + 2))
    times_s = np.linspace(0.0, max(duration_s, _STEP_S), count)
    points = np.array([position_w_m(time_s) for time_s in times_s.tolist()])
    tolerance_m = _TOLERANCE_M
    while True:
        kept = _needed(times_s, points, tolerance_m)
        if len(kept) <= most_knots:
            return TimedPath(times_s[kept], points[kept])
        tolerance_m *= 2.0


def _needed(times_s: Array, points: Array, tolerance_m: float) -> list[int]:
    """Return the indices of knots whose lines keep within the tolerance of all points at their times."""
    kept, spans = {0, len(times_s) - 1}, [(0, len(times_s) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        share = (times_s[first : last + 1] - times_s[first]) / (times_s[last] - times_s[first])
        line = points[first] + share[:, None] * (points[last] - points[first])
        off_m = np.linalg.norm(points[first : last + 1] - line, axis=1)
        worst = int(np.argmax(off_m))
        if off_m[worst] > tolerance_m:
            kept.add(first + worst)
            spans += [(first, first + worst), (first + worst, last)]
    return sorted(kept)
