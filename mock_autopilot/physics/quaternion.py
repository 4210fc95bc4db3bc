"""Unit quaternions, w x y z, turning body coordinates (FRD) into world coordinates (NED).

All functions broadcast over leading axes, in as few numpy calls as it takes. The mock has its own so that a sign error
in the companion's conversions cannot cancel against the same error here.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TINY = 1e-300
"""Keeps 0 / 0 apart where the quotient is multiplied by 0 anyway."""


def multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product of two quaternions, shape (..., 4).

    Each is read as two complex numbers, w + ix and y + iz: the product is then four of theirs (Cayley, Dickson).
    """
    left, right = np.ascontiguousarray(a).view(np.complex128), np.ascontiguousarray(b).view(np.complex128)
    other = right[..., ::-1].conj()
    other[..., 0] *= -1.0
    return np.asarray(left[..., :1] * right + left[..., 1:] * other).view(np.float64)


def conjugate(q: Array) -> Array:
    """Return the inverse rotation of a unit quaternion, shape (..., 4)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def unit(q: Array) -> Array:
    """Scale vectors to length 1 over the last axis."""
    return np.asarray(q / length(q))


def length(v: Array) -> Array:
    """Return the Euclidean length over the last axis, which stays: (..., 1)."""
    return np.asarray(np.sqrt(np.vecdot(v, v)[..., None]))


def from_rotation_vector(r: Array) -> Array:
    """Convert a rotation vector (rad), shape (..., 3), to a unit quaternion (exponential map)."""
    half = 0.5 * length(r)
    return np.concatenate((np.cos(half), 0.5 * r * np.sinc(half / np.pi)), axis=-1)


def to_rotation_vector(q: Array) -> Array:
    """Convert a unit quaternion to the shorter rotation vector (rad), shape (..., 3) (logarithm)."""
    w, v = q[..., :1], q[..., 1:]
    sine = length(v)
    return np.asarray(v * (np.copysign(2.0, w) * np.arctan2(sine, np.abs(w)) / np.maximum(sine, _TINY)))


def turned_by_small(q: Array, half_turn_rad: Array) -> Array:
    """Turn `q` by twice `half_turn_rad` (..., 3) about body axes; return shape (..., 4).

    The half angle's tangent is a series: 3e-8 of a half turn of 0.125 rad is wrong, which is 50 rad/s at 5 ms.
    """
    square = np.vecdot(half_turn_rad, half_turn_rad)[..., None]
    small = np.ones((*half_turn_rad.shape[:-1], 4))
    np.multiply(half_turn_rad, 1.0 + square * (1.0 / 3.0 + square * (2.0 / 15.0)), out=small[..., 1:])
    return unit(multiply(q, small))


def to_matrix(q: Array) -> Array:
    """Return the rotation matrix R with v_world = R v_body, shape (..., 3, 3)."""
    w, x, y, z = q.tolist() if q.ndim == 1 else (q[..., 0], q[..., 1], q[..., 2], q[..., 3])
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    if q.ndim == 1:
        return np.array(rows)
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def down_axis(q: Array) -> Array:
    """Return the body z axis (down through the belly) in world coordinates, shape (..., 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return np.stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)), axis=-1)


def from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Return the quaternion of the aerospace sequence yaw, pitch, roll, shape (4,)."""
    cr, sr = np.cos(roll_rad / 2), np.sin(roll_rad / 2)
    cp, sp = np.cos(pitch_rad / 2), np.sin(pitch_rad / 2)
    cy, sy = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def to_euler(q: Array) -> tuple[float, float, float]:
    """Return roll, pitch, yaw (rad) of one quaternion of shape (4,)."""
    w, x, y, z = (float(v) for v in q)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float(roll), float(pitch), float(yaw)


def turned_about_z(angle_rad: float, q: Array) -> Array:
    """Turn one attitude, shape (4,), about the world's vertical."""
    c, s = math.cos(angle_rad / 2.0), math.sin(angle_rad / 2.0)
    w, x, y, z = q.tolist()
    return np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])


def yaw_of(q: Array) -> float:
    """Return the heading (rad) of one quaternion of shape (4,)."""
    w, x, y, z = q.tolist()
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
