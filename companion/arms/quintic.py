"""Polynomials of the fifth order, piece by piece: what joint trajectories are made of."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from companion.core.types import Array, JointMotion


@dataclass(frozen=True)
class Quintics:
    """Polynomials of a share x of each piece; before the first and after the last piece at rest at the ends."""

    ends_s: tuple[float, ...]
    """(n + 1): times (s) at which pieces begin and end, rising from 0."""
    coefficients_rad: Array
    """(n, 6, 8): of 1, x .. x^5, by piece."""

    def at(self, time_s: float | Array) -> JointMotion:
        """Return the motion at one time (8,), or at each of an array (...,) of times (..., 8)."""
        if isinstance(time_s, np.ndarray):
            return self._at_many(time_s)
        piece = min(max(bisect_right(self.ends_s, time_s) - 1, 0), len(self.ends_s) - 2)
        span = self.ends_s[piece + 1] - self.ends_s[piece]
        x = min(max((time_s - self.ends_s[piece]) / span, 0.0), 1.0)
        x2, x3 = x * x, x * x * x
        v, a = 1.0 / span, 1.0 / (span * span)
        moving = self.ends_s[0] <= time_s <= self.ends_s[-1]
        if not moving:
            v = a = 0.0
        basis = np.array(
            (
                (1.0, x, x2, x3, x2 * x2, x2 * x3),
                (0.0, v, 2.0 * v * x, 3.0 * v * x2, 4.0 * v * x3, 5.0 * v * x2 * x2),
                (0.0, 0.0, 2.0 * a, 6.0 * a * x, 12.0 * a * x2, 20.0 * a * x3),
            )
        )
        position, velocity, acceleration = basis @ self.coefficients_rad[piece]
        return JointMotion(position, velocity, acceleration)

    def _at_many(self, time_s: Array) -> JointMotion:
        ends = np.array(self.ends_s)
        piece = np.clip(np.searchsorted(ends, time_s, side="right") - 1, 0, len(ends) - 2)
        span = np.diff(ends)[piece]
        x = np.clip((time_s - ends[piece]) / span, 0.0, 1.0)
        moving = (time_s >= ends[0]) & (time_s <= ends[-1])
        basis = np.zeros((*time_s.shape, 3, 6))
        for n in range(6):
            basis[..., 0, n] = x**n
            basis[..., 1, n] = n * x ** max(n - 1, 0) / span * moving
            basis[..., 2, n] = n * (n - 1) * x ** max(n - 2, 0) / span**2 * moving
        out = basis @ self.coefficients_rad[piece]
        return JointMotion(out[..., 0, :], out[..., 1, :], out[..., 2, :])


def between(start: JointMotion, end: JointMotion, duration_s: float | Array) -> Array:
    """Return the quintic (..., 6, 8) that meets both motions (..., 8) in a duration (s), one for all or (..., 1)."""
    p0, v0, a0 = start.position_rad, start.velocity_radps * duration_s, start.acceleration_radps2 * duration_s**2
    p1, v1, a1 = end.position_rad, end.velocity_radps * duration_s, end.acceleration_radps2 * duration_s**2
    way = p1 - p0
    terms = (
        p0,
        v0,
        0.5 * a0,
        10.0 * way - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
        -15.0 * way + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
        6.0 * way - 3.0 * (v0 + v1) - 0.5 * (a0 - a1),
    )
    return np.stack(terms, axis=-2)
