"""Distances between simple shapes, for many at once: segments, a box, discs. Metres; every frame the same."""

from collections.abc import Callable

import numpy as np

from companion.core.types import Array

HALVINGS = 16
"""Bisections in the search for the point of a segment nearest to a shape. The distance is too large by at most its
length / 2^16, 3 micrometres on a link, where it pierces the shape's edge or face; elsewhere it is far better."""


def between_segments_m(a0: Array, a1: Array, b0: Array, b1: Array) -> Array:
    """Return the least distance between segments a0-a1 and b0-b1, points (..., 3): (...,).

    Ericson, Real-Time Collision Detection, section 5.1.9: the lines' nearest points, drawn back onto the segments.
    """
    along_a, along_b, apart = a1 - a0, b1 - b0, a0 - b0
    aa, bb, ab = _dot(along_a, along_a), _dot(along_b, along_b), _dot(along_a, along_b)
    a_apart, b_apart = _dot(along_a, apart), _dot(along_b, apart)
    spread = aa * bb - ab * ab
    s = np.clip(_share(ab * b_apart - a_apart * bb, spread), 0.0, 1.0)
    t = np.clip(_share(ab * s + b_apart, bb), 0.0, 1.0)
    s = np.clip(_share(ab * t - a_apart, aa), 0.0, 1.0)
    return _length(apart + s[..., None] * along_a - t[..., None] * along_b)


def to_box_m(start: Array, end: Array, half: Array) -> Array:
    """Return the distance of segments (..., 3) from a box of half sides (3,) at the origin: (...,); inside 0."""

    def beyond(point: Array) -> Array:
        return np.asarray(point - np.clip(point, -half, half))

    return _least_to_convex(start, end, beyond)


def to_discs_m(start: Array, end: Array, centres: Array, radius: float) -> Array:
    """Return the distance of segments, points (..., 3), from each level disc with centres (n, 3): (..., n)."""

    def beyond(point: Array) -> Array:
        over = np.sqrt(point[..., 0] ** 2 + point[..., 1] ** 2)
        outside = np.maximum(over - radius, 0.0) / np.maximum(over, 1e-12)
        return np.stack((outside * point[..., 0], outside * point[..., 1], point[..., 2]), axis=-1)

    return _least_to_convex(start[..., None, :] - centres, end[..., None, :] - centres, beyond)


def _least_to_convex(start: Array, end: Array, beyond: Callable[[Array], Array]) -> Array:
    """Return the distance to a convex shape; `beyond` is the vector from its nearest point to a given one.

    Along a segment the distance to a convex shape has one valley: halve towards where it stops falling.
    """
    along = end - start
    low, high = np.zeros(along.shape[:-1]), np.ones(along.shape[:-1])
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        falls = _dot(beyond(start + middle[..., None] * along), along) < 0.0
        low, high = np.where(falls, middle, low), np.where(falls, high, middle)
    return np.minimum(*(_length(beyond(start + share[..., None] * along)) for share in (low, high)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(-1))


def _length(vector: Array) -> Array:
    return np.sqrt(_dot(vector, vector))


def _share(part: Array, whole: Array) -> Array:
    """Return part / whole, and 0 where the whole is 0: parallel segments, a segment of less than 32 nm."""
    return np.asarray(np.divide(part, whole, out=np.zeros_like(part), where=whole > 1e-15))
