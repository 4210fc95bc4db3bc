"""Unit quaternions, w x y z, turning body coordinates (FRD) into world coordinates (NED).

All functions broadcast over leading axes. The mock has its own so that a sign error in the
companion's conversions cannot cancel against the same error here.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product of two quaternions, shape (..., 4)."""
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return np.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        axis=-1,
    )


def conjugate(q: Array) -> Array:
    """The inverse rotation of a unit quaternion, shape (..., 4)."""
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def normalise(q: Array) -> Array:
    """Scale to unit length, shape (..., 4)."""
    return np.asarray(q / np.sqrt((q * q).sum(axis=-1, keepdims=True)))


def from_rotation_vector(r: Array) -> Array:
    """Exponential map: rotation vector (rad), shape (..., 3), to a unit quaternion."""
    half = 0.5 * np.sqrt((r * r).sum(axis=-1, keepdims=True))
    return np.concatenate((np.cos(half), 0.5 * r * np.sinc(half / np.pi)), axis=-1)


def to_rotation_vector(q: Array) -> Array:
    """Logarithm: unit quaternion to the shorter rotation vector (rad), shape (..., 3)."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.sqrt((q[..., 1:] ** 2).sum(axis=-1, keepdims=True))
    half = np.arctan2(sine, q[..., :1])
    return np.asarray(q[..., 1:] * 2.0 / np.maximum(np.sinc(half / np.pi), 1e-12))


def to_matrix(q: Array) -> Array:
    """Rotation matrix R with v_world = R v_body, shape (..., 3, 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = (
        np.stack((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)), axis=-1),
        np.stack((2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)), axis=-1),
        np.stack((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), axis=-1),
    )
    return np.stack(rows, axis=-2)


def down_axis(q: Array) -> Array:
    """Body z axis (down through the belly) in world coordinates, shape (..., 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return np.stack((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)), axis=-1)


def from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Quaternion of the aerospace sequence yaw, pitch, roll, shape (4,)."""
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
    """Roll, pitch, yaw (rad) of one quaternion of shape (4,)."""
    w, x, y, z = (float(v) for v in q)
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return float(roll), float(pitch), float(yaw)


def turned_about_z(angle_rad: float, q: Array) -> Array:
    """One attitude after a further turn of the world axes about the vertical, shape (4,)."""
    c, s = math.cos(angle_rad / 2.0), math.sin(angle_rad / 2.0)
    w, x, y, z = q.tolist()
    return np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])


def yaw_of(q: Array) -> float:
    """Heading (rad) of one quaternion of shape (4,)."""
    w, x, y, z = q.tolist()
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
