"""Attitude and body rate from measured rotations, by the same filter as the position.

Works on components: floats for one vehicle, whose frame has to cost microseconds, and arrays (...,) for a batch.
"""

from companion.core.types import Array, Flag, Scalar
from companion.core.values import value
from companion.estimation.kalman import Covariance, grow, shrink
from companion.geometry.array_math import absolute, math_module, unstack
from companion.geometry.frames import Quat, quat_from_matrix, quat_product

Vector = tuple[Scalar, Scalar, Scalar]

_TINY = 1e-300
"""Added to a divisor, so that 0/0 becomes 0; changes nothing else."""


@value
class Attitude:
    """Estimate at one instant: q turns FLU into W (w x y z, w >= 0); rate (rad/s) and its change (rad/s^2) in FLU."""

    q: Quat
    rate: Vector
    turn: Vector
    covariance: Covariance
    """Covariance of angle error, rate and change of rate about one body axis: floats or (...,)."""


def is_rotation(rotation_rows: tuple[float, ...], tolerance: float = 0.01) -> Flag:
    """Return True if nine numbers, row by row, are a right-handed rotation; False for NaN."""
    a, b, c, d, e, f, g, h, i = rotation_rows
    return (
        (abs(a * a + b * b + c * c - 1.0) <= tolerance)
        & (abs(d * d + e * e + f * f - 1.0) <= tolerance)
        & (abs(a * d + b * e + c * f) <= tolerance)
        & (abs(b * f - c * e - g) <= tolerance)  # row 1 x row 2 = row 3
        & (abs(c * d - a * f - h) <= tolerance)
        & (abs(a * e - b * d - i) <= tolerance)
    )


def at_rest(rotation: Array, covariance: Covariance) -> Attitude:
    """Return the estimate from one rotation matrix, shape (..., 3, 3), at rest."""
    w, x, y, z = unstack(quat_from_matrix(rotation))
    still = (0.0 * w, 0.0 * w, 0.0 * w)
    return Attitude((w, x, y, z), still, still, covariance)


def predict(state: Attitude, dt_s: Scalar, density: float) -> Attitude:
    """Predict the attitude after `dt_s`, a float or (...,); `density` in rad^2/s^5."""
    (p, q, r), (dp, dq, dr) = state.rate, state.turn
    half = 0.5 * dt_s * dt_s
    step = _exp((dt_s * p + half * dp, dt_s * q + half * dq, dt_s * r + half * dr))
    rate = (p + dt_s * dp, q + dt_s * dq, r + dt_s * dr)
    return Attitude(quat_product(state.q, step), rate, state.turn, grow(state.covariance, dt_s, density))


def innovation_rad(state: Attitude, rotation_rows: tuple[Scalar, ...]) -> Vector:
    """Return the rotation vector (FLU, rad) from the estimate to a measured matrix, nine numbers row by row.

    The logarithm of R' M, with the columns of the estimate's R written out: a third of the time of the array calls.
    """
    w, x, y, z = state.q
    a, b, c, d, e, f, g, h, i = rotation_rows
    r00, r10, r20 = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    r01, r11, r21 = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    r02, r12, r22 = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    about_x = (r02 * b + r12 * e + r22 * h) - (r01 * c + r11 * f + r21 * i)
    about_y = (r00 * c + r10 * f + r20 * i) - (r02 * a + r12 * d + r22 * g)
    about_z = (r01 * a + r11 * d + r21 * g) - (r00 * b + r10 * e + r20 * h)
    trace = (r00 * a + r10 * d + r20 * g) + (r01 * b + r11 * e + r21 * h) + (r02 * c + r12 * f + r22 * i)
    m = math_module(w)
    twice_sine = m.sqrt(about_x * about_x + about_y * about_y + about_z * about_z)
    scale = m.atan2(twice_sine, trace - 1.0) / (twice_sine + _TINY)
    return scale * about_x, scale * about_y, scale * about_z


def innovation_of_quat_rad(state: Attitude, measured: Quat) -> Vector:
    """Return the same for a measured unit quaternion (w x y z, either sign): cheaper for a batch without matrices."""
    w, x, y, z = state.q
    turn_w, turn_x, turn_y, turn_z = quat_product((w, -x, -y, -z), measured)
    m = math_module(w)
    sine = m.sqrt(turn_x * turn_x + turn_y * turn_y + turn_z * turn_z)
    scale = m.copysign(2.0, turn_w) * m.atan2(sine, absolute(turn_w)) / (sine + _TINY)
    return scale * turn_x, scale * turn_y, scale * turn_z


def update(state: Attitude, innovation: Vector, variance: float) -> Attitude:
    """Correct by the rotation vector of `innovation_rad`, measured with `variance` (rad^2) about every axis."""
    (ka, kr, kt), covariance = shrink(state.covariance, variance)
    (x, y, z), (p, q, r), (dp, dq, dr) = innovation, state.rate, state.turn
    return Attitude(
        _normalised(quat_product(state.q, _exp((ka * x, ka * y, ka * z)))),
        (p + kr * x, q + kr * y, r + kr * z),
        (dp + kt * x, dq + kt * y, dr + kt * z),
        covariance,
    )


def _exp(vector: Vector) -> Quat:
    x, y, z = vector
    m = math_module(x)
    angle = m.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    scale = m.sin(half) / (angle + _TINY)
    return m.cos(half), scale * x, scale * y, scale * z


def _normalised(quat: Quat) -> Quat:
    w, x, y, z = quat
    m = math_module(w)
    scale = m.copysign(1.0, w) / m.sqrt(w * w + x * x + y * y + z * z)
    return scale * w, scale * x, scale * y, scale * z
