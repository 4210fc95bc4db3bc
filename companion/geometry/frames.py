"""Frames and rotations: the paper's W (z up) with body FLU inside, the autopilot's NED with FRD at the edge.

W has its x axis where the autopilot has north, so NED is (x, -y, -z) of W, and FRD is (x, -y, -z) of FLU.
Quaternions are unit, w x y z, and turn body coordinates into world coordinates. All broadcast over leading axes.
"""

from collections.abc import Callable, Sequence
from math import asin, atan2, degrees
from typing import cast

import numpy as np

from companion.core.types import Array, Scalar, Vec3
from companion.geometry.array_math import absolute, math_module, maximum, stack, unstack, where, where_each

Quat = tuple[Scalar, Scalar, Scalar, Scalar]
_FLIP = np.array([1.0, -1.0, -1.0])
_FLIP_Q = np.array([1.0, 1.0, -1.0, -1.0])
_TINY = 1e-100
"""An angle (rad) whose sine is itself, and which may be divided by."""
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def flip_yz(vector: Array) -> Array:
    """Convert between W and NED, or between FLU and FRD: all the same half turn about x, shape (..., 3)."""
    return np.asarray(vector * _FLIP)


def flip_quat(q: Array) -> Array:
    """Convert an attitude W<-FLU to NED<-FRD or back, shape (..., 4)."""
    return np.asarray(q * _FLIP_Q)


def quat_multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product, shape (..., 4)."""
    return stack(*quat_product(unstack(a), unstack(b)))


def quat_product(a: Sequence[Scalar], b: Sequence[Scalar]) -> Quat:
    """Return the Hamilton product of quaternions given by their components."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a, b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def quat_conjugate(q: Array) -> Array:
    """Return the inverse rotation, shape (..., 4)."""
    return np.asarray(q * _CONJUGATE)


def quat_from_rotation_vector(r: Array) -> Array:
    """Return the quaternion (..., 4) of a rotation vector (rad), shape (..., 3)."""
    x, y, z = unstack(r)
    m = math_module(x)
    half = maximum(0.5 * m.sqrt(x * x + y * y + z * z), _TINY)
    share = 0.5 * m.sin(half) / half
    return stack(m.cos(half), share * x, share * y, share * z)


def rotation_vector_from_quat(q: Array) -> Array:
    """Return the shorter rotation vector of a quaternion (rad), shape (..., 3)."""
    w, x, y, z = unstack(q)
    m = math_module(w)
    half = maximum(m.atan2(m.sqrt(x * x + y * y + z * z), absolute(w)), _TINY)
    share = where(w < 0.0, -2.0, 2.0) * half / m.sin(half)
    return stack(share * x, share * y, share * z)


def quat_from_yaw(yaw_rad: Scalar) -> Array:
    """Return the level attitude with this heading, shape (..., 4)."""
    m, half, zero = math_module(yaw_rad), 0.5 * yaw_rad, 0.0 * yaw_rad
    return stack(m.cos(half), zero, zero, m.sin(half))


def matrix_from_quat(q: Array) -> Array:
    """Return the rotation matrix R, v_w = R v_b, shape (..., 3, 3)."""
    w, x, y, z = unstack(q)
    row_by_row = stack(
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return row_by_row.reshape(*q.shape[:-1], 3, 3)


def turned(q: Array, vector: Array) -> Array:
    """Rotate a vector (..., 3) from body to world axes: v + 2 w (u x v) + 2 u x (u x v) with q = (w, u)."""
    (w, x, y, z), (a, b, c) = unstack(q), unstack(vector)
    i, j, k = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return stack(a + w * i + y * k - z * j, b + w * j + z * i - x * k, c + w * k + x * j - y * i)


def quat_from_matrix(rotation: Array) -> Array:
    """Return the quaternion of a rotation matrix, shape (..., 4), w >= 0.

    Takes the largest of the four squared components as the divisor (Shepperd's method), so no direction
    is singular.
    """
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = unstack(rotation.reshape(*rotation.shape[:-2], 9))
    skew_x, skew_y, skew_z = m21 - m12, m02 - m20, m10 - m01
    sum_xy, sum_xz, sum_yz = m01 + m10, m02 + m20, m12 + m21
    candidates = (
        (m00 + m11 + m22, (1 + m00 + m11 + m22, skew_x, skew_y, skew_z)),
        (m00 - m11 - m22, (skew_x, 1 + m00 - m11 - m22, sum_xy, sum_xz)),
        (m11 - m00 - m22, (skew_y, sum_xy, 1 - m00 + m11 - m22, sum_yz)),
        (m22 - m00 - m11, (skew_z, sum_xz, sum_yz, 1 - m00 - m11 + m22)),
    )
    best = candidates[0]
    for candidate in candidates[1:]:
        best = where_each(candidate[0] > best[0], candidate, best)
    _, (w, x, y, z) = best
    size = math_module(w).sqrt(w * w + x * x + y * y + z * z)
    size = where(w < 0.0, -size, size)
    return stack(w / size, x / size, y / size, z / size)


def up_axis(q_w_flu_wxyz: Array) -> Array:
    """Return the body z axis (the direction the rotors push) in W, shape (..., 3)."""
    return stack(*up_axis_parts(q_w_flu_wxyz))


def up_axis_parts(q_w_flu_wxyz: Array) -> tuple[Scalar, Scalar, Scalar]:
    """Return the components of `up_axis`: floats, arrays (...,) for a batch."""
    w, x, y, z = unstack(q_w_flu_wxyz)
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


up_axis_floats = cast(Callable[[Array], Vec3], up_axis_parts)
"""Return the components of `up_axis` of one vehicle."""


def yaw_of(q_w_flu_wxyz: Array) -> Array:
    """Return the heading (rad) of the body x axis in W, counter-clockwise from x, shape (...,)."""
    w, x, y, z = unstack(q_w_flu_wxyz)
    return np.asarray(math_module(w).atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def euler_ned_frd_deg(q_w_flu_wxyz: Array) -> tuple[float, float, float]:
    """Return roll, pitch, yaw (degrees, aerospace sequence, NED<-FRD) of one attitude, for MAVSDK's set_attitude."""
    w, x, y, z = flip_quat(q_w_flu_wxyz).tolist()
    roll = atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = asin(min(1.0, max(-1.0, 2 * (w * y - z * x))))
    yaw = atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return degrees(roll), degrees(pitch), degrees(yaw)
