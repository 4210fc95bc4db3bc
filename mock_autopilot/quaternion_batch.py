"""quaternion.py's maths for batches, in as few numpy calls as it takes; conventions and shapes are the same.

A quaternion is read as two complex numbers, w + ix and y + iz: its product is then four of theirs (Cayley and Dickson).
"""

import numpy as np

from mock_autopilot.quaternion import Array

_TINY = 1e-300
"""Keeps 0 / 0 apart where the quotient is multiplied by 0 anyway."""


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product of two quaternions, shape (..., 4)."""
    left, right = np.ascontiguousarray(a).view(np.complex128), np.ascontiguousarray(b).view(np.complex128)
    other = right[..., ::-1].conj()
    other[..., 0] *= -1.0
    return np.asarray(left[..., :1] * right + left[..., 1:] * other).view(np.float64)


def unit(q: Array) -> Array:
    """Scaled to length 1, any last axis."""
    return np.asarray(q / length(q))


def to_rotation_vector(q: Array) -> Array:
    """Logarithm: unit quaternion to the shorter rotation vector (rad), shape (..., 3)."""
    w, v = q[..., :1], q[..., 1:]
    sine = length(v)
    return np.asarray(v * (np.copysign(2.0, w) * np.arctan2(sine, np.abs(w)) / np.maximum(sine, _TINY)))


def turned_by_small(q: Array, half_turn_rad: Array) -> Array:
    """`q` after a further turn by twice `half_turn_rad` (..., 3) about body axes, shape (..., 4).

    The tangent of the half angle is a series: 2e-8 of a half turn of 0.125 rad is wrong, which is 50 rad/s at 5 ms.
    """
    square = np.vecdot(half_turn_rad, half_turn_rad)[..., None]
    small = np.ones((*half_turn_rad.shape[:-1], 4))
    np.multiply(half_turn_rad, 1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0)), out=small[..., 1:])
    return unit(multiply(q, small))


def length(v: Array) -> Array:
    """Euclidean, over the last axis, which stays: (..., 1)."""
    return np.asarray(np.sqrt(np.vecdot(v, v)[..., None]))
