"""The last gate before the autopilot: finite, tilt, thrust, rate of change. It knows no controller.

Deliberately simpler than anything in front of it: what comes in is cut to what may go out, whoever asks.
"""

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array, AttitudeThrust
from companion.core.values import value
from companion.geometry.array_math import any_true, column, dot, math_module, maximum, minimum, number, stack, where
from companion.geometry.frames import (
    quat_conjugate,
    quat_from_rotation_vector,
    quat_multiply,
    rotation_vector_from_quat,
    up_axis_parts,
)

Mask = NDArray[np.bool_]

_CLEARLY = 1e-9
"""Margin of a quick look at a limit: what passes is inside beyond rounding, all else is looked at exactly."""


def _no() -> Mask:
    return np.array(False)


@dataclass(frozen=True)
class Limits:
    """What may be sent; each bound with its unit."""

    max_tilt_rad: float = 0.52
    """Tilt cone about the vertical."""
    min_thrust: float = 0.05
    max_thrust: float = 0.80
    max_turn_radps: float = 6.0
    """Rate of change of the attitude setpoint."""
    max_thrust_rate_ps: float = 5.0
    """Rate of change of the normalised thrust, 1/s."""


@value
class LimitedSetpoint:
    """What goes out, and what was cut: flags (...,) for the record and for the safety rules."""

    setpoint: AttitudeThrust
    not_finite: Mask
    tilt_cut: Mask
    thrust_cut: Mask
    slew_cut: Mask
    _: KW_ONLY
    age_cut: Mask = field(default_factory=_no)
    """By the guard: the state was too old to be steered by."""
    fence_cut: Mask = field(default_factory=_no)
    """By the guard: less towards the fence than was wanted."""
    failure: str = ""
    """Why the guard itself failed and levelled the vehicle; empty when it did not."""


def limit_setpoint(wanted: AttitudeThrust, last: AttitudeThrust, limits: Limits, dt_s: float) -> LimitedSetpoint:
    """Cut `wanted` to the limits, `dt_s` after `last` went out; shapes (..., 4) and (...,).

    What is not finite, or no attitude at all, is replaced by `last`. The tilt is cut after the slew, so that no
    path between two allowed attitudes leaves the cone.
    """
    q, asked, not_finite = _usable(wanted, last)
    turned, turn_cut = _slew_attitude(q, last.q_w_flu_wxyz, limits.max_turn_radps * dt_s)
    inside, tilt_cut = inside_cone(turned, limits.max_tilt_rad)
    thrust, before, step = (
        _between(asked, limits.min_thrust, limits.max_thrust),
        number(last.thrust),
        limits.max_thrust_rate_ps * dt_s,
    )
    slewed = _between(thrust, before - step, before + step)
    cuts = map(np.asarray, (not_finite, tilt_cut, thrust != asked, turn_cut | (slewed != thrust)))
    return LimitedSetpoint(AttitudeThrust(inside, np.asarray(slewed)), *cuts)


def _between(value: Any, low: Any, high: Any) -> Any:
    return minimum(maximum(value, low), high)


def _usable(wanted: AttitudeThrust, last: AttitudeThrust) -> tuple[Array, Any, Any]:
    """Unit quaternion (..., 4) and thrust, where there is none the last one's; and where there was none."""
    q, thrust = wanted.q_w_flu_wxyz, number(wanted.thrust)
    length = _length(q)
    usable = (abs(length - 1.0) < 1e-3) & math_module(thrust).isfinite(thrust)
    bad = usable ^ True  # "not", of a truth value and of an array
    if not any_true(bad):
        return q / column(length), thrust, bad
    safe_q = where(column(bad), last.q_w_flu_wxyz, q)
    return safe_q / column(_length(safe_q)), where(bad, number(last.thrust), thrust), bad


def _length(q: Array) -> Any:
    if q.ndim == 1:
        return math.hypot(*q.tolist())
    with np.errstate(invalid="ignore", over="ignore"):
        return np.sqrt(dot(q, q))


def _slew_attitude(q: Array, last: Array, max_turn_rad: float) -> tuple[Array, Any]:
    far = abs(dot(last, q)) <= math.cos(min(0.5 * max_turn_rad, 0.5 * math.pi)) + _CLEARLY
    if not any_true(far):
        return q, far
    vector = rotation_vector_from_quat(quat_multiply(quat_conjugate(last), q))
    square = dot(vector, vector)
    angle = math_module(square).sqrt(square)
    cut = angle > max_turn_rad
    # the smaller of the two: without a time limit the allowed turn is infinite, and 0 times infinity is no number
    shorter = vector * column(minimum(angle, max_turn_rad) / maximum(angle, 1e-12))
    return where(column(cut), quat_multiply(last, quat_from_rotation_vector(shorter)), q), cut


def inside_cone(q: Array, max_tilt_rad: float) -> tuple[Array, Any]:
    """Turn back along the shortest way to the cone, about the horizontal axis the vehicle is tilted around.

    Unit quaternions (..., 4) that tilt by `max_tilt_rad` at most, and where one was cut, (...,).
    """
    x, y, z = up_axis_parts(q)
    beyond = z <= math.cos(min(max_tilt_rad, math.pi)) + _CLEARLY
    if not any_true(beyond):
        return q, beyond
    m = math_module(z)
    horizontal = m.sqrt(x * x + y * y)
    tilt = m.atan2(horizontal, z)
    cut, size = tilt > max_tilt_rad, maximum(horizontal, 1e-9)
    # the horizontal axis about which level was tilted to `up`: e3 x up; exactly inverted any will do
    axis_x, axis_y = where(horizontal > 1e-9, -y / size, 1.0), where(horizontal > 1e-9, x / size, 0.0)
    back = 0.5 * (max_tilt_rad - tilt)
    turn_back = stack(m.cos(back), axis_x * m.sin(back), axis_y * m.sin(back), 0.0 * back)
    return where(column(cut), quat_multiply(turn_back, q), q), cut
