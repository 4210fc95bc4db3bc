"""Limits of a setpoint: finite, tilt, thrust, rate of change. Independent of the controller.

Deliberately simpler than everything in front of it: any setpoint is cut to the limits, whatever its source.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from companion.core.types import Array, AttitudeThrust, Flag, Mask, Scalar
from companion.core.values import value
from companion.geometry.array_math import (
    absolute,
    any_true,
    column,
    dot,
    item,
    length,
    math_module,
    maximum,
    minimum,
    stack,
    where,
)
from companion.geometry.frames import (
    quat_conjugate,
    quat_from_rotation_vector,
    quat_multiply,
    rotation_vector_from_quat,
    up_axis_parts,
)

_CLEARLY = 1e-9
"""Margin of the quick check of a limit: what passes is inside despite rounding, the rest is checked exactly."""


def _no() -> Mask:
    return np.array(False)


@dataclass(frozen=True)
class Limits:
    """Limits of the setpoints sent to the autopilot."""

    max_tilt_rad: float = 0.52
    """Half angle of the tilt cone about the vertical."""
    min_thrust: float = 0.05
    max_thrust: float = 0.80
    max_turn_radps: float = 6.0
    """Largest rate of change of the attitude setpoint."""
    max_thrust_rate_ps: float = 5.0
    """Largest rate of change of the normalised thrust, 1/s."""


@value(kw_only=True)
class LimitedSetpoint:
    """Setpoint inside the limits, and flags (...,) of what was cut, for the record and for the supervisor."""

    setpoint: AttitudeThrust
    not_finite: Mask
    tilt_cut: Mask
    thrust_cut: Mask
    slew_cut: Mask
    age_cut: Mask = field(default_factory=_no)
    """Cut by the guard because the state was too old."""
    fence_cut: Mask = field(default_factory=_no)
    """Cut by the guard because of the geofence."""
    separation_cut: Mask = field(default_factory=_no)
    """Cut by the guard because of another vehicle."""
    failure: str = ""
    """Error for which the guard failed and levelled the vehicle; empty when it did not fail."""


def limit_setpoint(setpoint: AttitudeThrust, last: AttitudeThrust, limits: Limits, dt_s: float) -> LimitedSetpoint:
    """Cut `setpoint` to the limits, `dt_s` after `last` was sent; shapes (..., 4) and (...,).

    Values that are not finite, or no valid attitude, are replaced by those of `last`. The tilt is cut after the rate,
    so that no path between two allowed attitudes leaves the cone.
    """
    q, commanded, not_finite = _valid_or_last(setpoint, last)
    turned, turn_cut = _slew_attitude(q, last.q_w_flu_wxyz, limits.max_turn_radps * dt_s)
    inside, tilt_cut = inside_cone(turned, limits.max_tilt_rad)
    thrust, before, step = (
        _clip(commanded, limits.min_thrust, limits.max_thrust),
        item(last.thrust),
        limits.max_thrust_rate_ps * dt_s,
    )
    slewed = _clip(thrust, before - step, before + step)
    return LimitedSetpoint(
        setpoint=AttitudeThrust(inside, np.asarray(slewed)),
        not_finite=np.asarray(not_finite),
        tilt_cut=np.asarray(tilt_cut),
        thrust_cut=np.asarray(thrust != commanded),
        slew_cut=np.asarray(turn_cut | (slewed != thrust)),
    )


def _clip(value: Scalar, low: Scalar, high: Scalar) -> Scalar:
    return minimum(maximum(value, low), high)


def _valid_or_last(setpoint: AttitudeThrust, last: AttitudeThrust) -> tuple[Array, Scalar, Flag]:
    """Return unit quaternion (..., 4), thrust, and where they were not valid, (...,): there `last` replaces them."""
    q, thrust = setpoint.q_w_flu_wxyz, item(setpoint.thrust)
    size = _length(q)
    usable = (absolute(size - 1.0) < 1e-3) & math_module(thrust).isfinite(thrust)
    bad = usable ^ True  # "not", of a truth value and of an array
    if not any_true(bad):
        return q / column(size), thrust, bad
    safe_q, size = where(column(bad), last.q_w_flu_wxyz, q), where(bad, _length(last.q_w_flu_wxyz), size)
    return safe_q / column(size), where(bad, item(last.thrust), thrust), bad


def _length(q: Array) -> Scalar:
    if q.ndim == 1:
        return length(q)
    with np.errstate(invalid="ignore", over="ignore"):
        return length(q)


def _slew_attitude(q: Array, last: Array, max_turn_rad: float) -> tuple[Array, Flag]:
    half_rad = minimum(0.5 * max_turn_rad, 0.5 * math.pi)
    far = absolute(dot(last, q)) <= math_module(half_rad).cos(half_rad) + _CLEARLY
    if not any_true(far):
        return q, far
    vector = rotation_vector_from_quat(quat_multiply(quat_conjugate(last), q))
    square = dot(vector, vector)
    angle = math_module(square).sqrt(square)
    cut = where(far, angle > max_turn_rad, far)
    # the smaller of the two: without a time limit the allowed turn is infinite, and 0 times infinity is no item
    shorter = vector * column(minimum(angle, max_turn_rad) / maximum(angle, 1e-12))
    return where(column(cut), quat_multiply(last, quat_from_rotation_vector(shorter)), q), cut


def inside_cone(q: Array, max_tilt_rad: float) -> tuple[Array, Flag]:
    """Turn attitudes back to the tilt cone the shortest way, about the horizontal axis they are tilted around.

    Returns unit quaternions (..., 4) that tilt by `max_tilt_rad` at most, and where one was cut, (...,).
    """
    x, y, z = up_axis_parts(q)
    most_rad = minimum(max_tilt_rad, math.pi)
    beyond = z <= math_module(most_rad).cos(most_rad) + _CLEARLY
    if not any_true(beyond):
        return q, beyond
    m = math_module(z)
    horizontal = m.sqrt(x * x + y * y)
    tilt = m.atan2(horizontal, z)
    cut, size = where(beyond, tilt > max_tilt_rad, beyond), maximum(horizontal, 1e-9)
    # the horizontal axis about which level was tilted to `up`: e3 x up; exactly inverted, any axis is right
    axis_x, axis_y = where(horizontal > 1e-9, -y / size, 1.0), where(horizontal > 1e-9, x / size, 0.0)
    back = 0.5 * (max_tilt_rad - tilt)
    turn_back = stack(m.cos(back), axis_x * m.sin(back), axis_y * m.sin(back), 0.0 * back)
    return where(column(cut), quat_multiply(turn_back, q), q), cut
