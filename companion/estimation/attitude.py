"""Attitude and body rate from rotation matrices, by the same filter as the position.

Scalars instead of arrays: one vehicle's frame has to cost microseconds, and array calls on four numbers do not.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, sin, sqrt

import numpy as np

from companion.control.frames import matrix_from_quat, quat_from_matrix
from companion.estimation.kalman import Covariance, gains, grow, shrink
from companion.types import Array

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]


@dataclass(frozen=True)
class Attitude:
    """Estimate at one instant: q turns FLU into W (w x y z, w >= 0); rate (rad/s) and its change (rad/s^2) in FLU."""

    q: Quat
    rate: Vec3
    turn: Vec3
    covariance: Covariance
    """Of angle error, rate and change of rate about one body axis."""


def is_rotation(rotation_rows: tuple[float, ...], tolerance: float = 0.01) -> bool:
    """Whether nine numbers, row by row, are a right-handed rotation; false for NaN."""
    a, b, c, d, e, f, g, h, i = rotation_rows
    crossed = (b * f - c * e - g, c * d - a * f - h, a * e - b * d - i)  # row 1 x row 2 - row 3
    lengths = (a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0)
    return all(abs(x) <= tolerance for x in (*crossed, *lengths, a * d + b * e + c * f))


def at_rest(rotation: Array, covariance: Covariance) -> Attitude:
    """Start from one matrix, shape (3, 3), not turning."""
    w, x, y, z = quat_from_matrix(rotation).tolist()
    return Attitude((w, x, y, z), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), covariance)


def predict(state: Attitude, dt_s: float, density: float) -> Attitude:
    """Turn on for `dt_s`; `density` in rad^2/s^5."""
    (p, q, r), (dp, dq, dr) = state.rate, state.turn
    half = 0.5 * dt_s * dt_s
    step = _exp((dt_s * p + half * dp, dt_s * q + half * dq, dt_s * r + half * dr))
    rate = (p + dt_s * dp, q + dt_s * dq, r + dt_s * dr)
    return Attitude(_multiply(state.q, step), rate, state.turn, grow(state.covariance, dt_s, density))


def surprise_rad(state: Attitude, rotation: Array) -> Vec3:
    """Rotation vector (FLU) from the estimate to the measured matrix, shape (3, 3)."""
    error = matrix_from_quat(np.array(state.q)).T @ rotation
    a, b, c, d, e, f, g, h, i = error.ravel().tolist()
    x, y, z = h - f, c - g, d - b
    sine2 = hypot(x, y, z)
    angle = atan2(sine2, a + e + i - 1.0)
    scale = angle / sine2 if sine2 > 1e-12 else 0.5
    return scale * x, scale * y, scale * z


def update(state: Attitude, surprise: Vec3, variance: float) -> Attitude:
    """Correct by the rotation vector of `surprise_rad`, measured with `variance` (rad^2) about every axis."""
    ka, kr, kt = gains(state.covariance, variance)
    (x, y, z), (p, q, r), (dp, dq, dr) = surprise, state.rate, state.turn
    return Attitude(
        _normalised(_multiply(state.q, _exp((ka * x, ka * y, ka * z)))),
        (p + kr * x, q + kr * y, r + kr * z),
        (dp + kt * x, dq + kt * y, dr + kt * z),
        shrink(state.covariance, variance),
    )


def _exp(vector: Vec3) -> Quat:
    x, y, z = vector
    angle = hypot(x, y, z)
    scale = sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    return cos(0.5 * angle), scale * x, scale * y, scale * z


def _multiply(first: Quat, second: Quat) -> Quat:
    (aw, ax, ay, az), (bw, bx, by, bz) = first, second
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _normalised(quat: Quat) -> Quat:
    w, x, y, z = quat
    scale = (1.0 if w >= 0.0 else -1.0) / sqrt(w * w + x * x + y * y + z * z)
    return scale * w, scale * x, scale * y, scale * z
