"""A reference through timed waypoints: at rest at both ends, smooth to the third derivative between."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from companion.types import Array, Reference


@dataclass(frozen=True)
class Waypoints:
    """Times (n,) from 0 (s), positions (n, 3) in W (m), headings (n,) (rad).

    A quintic spline: one fifth-order polynomial a segment, continuous up to snap at the waypoints, at rest with no
    acceleration at both ends.
    """

    times_s: Array
    positions_w_m: Array
    yaws_rad: Array

    @property
    def duration_s(self) -> float:
        """The last waypoint's time."""
        return float(self.times_s[-1])

    def at(self, time_s: float) -> Reference:
        """The spline at `time_s`."""
        t = min(max(time_s, 0.0), self.duration_s)
        segment = int(np.clip(np.searchsorted(self.times_s, t, side="right") - 1, 0, len(self.times_s) - 2))
        x = t - self.times_s[segment]
        position, velocity, acceleration = (_powers(x, order) @ self._coefficients[segment] for order in range(3))
        return Reference(position[:3], velocity[:3], acceleration[:3], float(position[3]))

    @cached_property
    def _coefficients(self) -> Array:
        """(segments, 6, 4): solved once from the interpolation, continuity and end conditions."""
        values = np.concatenate((self.positions_w_m, np.unwrap(self.yaws_rad)[:, None]), axis=1)
        spans = np.diff(self.times_s)
        count = len(spans)
        rows: list[Array] = []
        right: list[Array] = []

        def require(parts: dict[int, Array], value: Array) -> None:
            row = np.zeros(6 * count)
            for segment, weights in parts.items():
                row[6 * segment : 6 * segment + 6] = weights
            rows.append(row)
            right.append(value)

        still = np.zeros(4)
        for s in range(count):
            require({s: _powers(0.0, 0)}, values[s])
            require({s: _powers(spans[s], 0)}, values[s + 1])
        for s in range(count - 1):
            for order in range(1, 5):
                require({s: _powers(spans[s], order), s + 1: -_powers(0.0, order)}, still)
        for order in (1, 2):
            require({0: _powers(0.0, order)}, still)
            require({count - 1: _powers(spans[-1], order)}, still)
        return np.linalg.solve(np.array(rows), np.array(right)).reshape(count, 6, 4)


def _powers(x: float, order: int) -> Array:
    """The `order`-th derivative of (1, x, ..., x^5)."""
    weights = np.zeros(6)
    for n in range(order, 6):
        factor = float(np.prod(np.arange(n - order + 1, n + 1)))
        weights[n] = factor * x ** (n - order)
    return weights
