"""The last gate before the autopilot: finite, tilt, thrust, rate of change. It knows no controller.

Deliberately simpler than anything in front of it: what comes in is cut to what may go out, whoever asks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.control.components import parts
from companion.control.frames import (
    quat_conjugate,
    quat_from_rotation_vector,
    quat_multiply,
    rotation_vector_from_quat,
    up_axis,
)
from companion.types import Array, AttitudeThrust

Mask = NDArray[np.bool_]

_CLEARLY = 1e-9
"""Margin of a quick look at a limit: what passes is inside beyond rounding, all else is looked at exactly."""


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


@dataclass(frozen=True)
class Gated:
    """What goes out, and what was cut: flags (...,) for the record and for the safety rules."""

    setpoint: AttitudeThrust
    not_finite: Mask
    tilt_cut: Mask
    thrust_cut: Mask
    slew_cut: Mask


def gate(wanted: AttitudeThrust, last: AttitudeThrust, limits: Limits, dt_s: float) -> Gated:
    """Cut `wanted` to the limits, `dt_s` after `last` went out; shapes (..., 4) and (...,).

    What is not finite, or no attitude at all, is replaced by `last`. The tilt is cut after the slew, so that no
    path between two allowed attitudes leaves the cone.
    """
    usable, not_finite = _usable(wanted, last)
    turned, turn_cut = _slew_attitude(usable.q_w_flu_wxyz, last.q_w_flu_wxyz, limits.max_turn_radps * dt_s)
    q, tilt_cut = _inside_cone(turned, limits.max_tilt_rad)
    thrust = _between(usable.thrust, limits.min_thrust, limits.max_thrust)
    thrust_cut = thrust != usable.thrust
    step = limits.max_thrust_rate_ps * dt_s
    slewed = _between(thrust, last.thrust - step, last.thrust + step)
    slew_cut = turn_cut | (slewed != thrust)
    return Gated(AttitudeThrust(q, slewed), not_finite, tilt_cut, thrust_cut, slew_cut)


def _between(value: Array, low: Array | float, high: Array | float) -> Array:
    """np.clip takes three times as long."""
    return np.asarray(np.minimum(np.maximum(value, low), high))


def _usable(wanted: AttitudeThrust, last: AttitudeThrust) -> tuple[AttitudeThrust, Mask]:
    q, thrust = wanted.q_w_flu_wxyz, wanted.thrust
    w, x, y, z = parts(q)
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt(w * w + x * x + y * y + z * z)
        ok = (np.abs(length - 1.0) < 1e-3) & np.isfinite(thrust)
    if ok.all():
        return AttitudeThrust(q / length[..., None], thrust), ~ok
    safe_q = np.where(ok[..., None], q, last.q_w_flu_wxyz)
    safe_q = safe_q / np.sqrt((safe_q * safe_q).sum(axis=-1, keepdims=True))
    return AttitudeThrust(safe_q, np.where(ok, thrust, last.thrust)), ~ok


def _slew_attitude(q: Array, last: Array, max_turn_rad: float) -> tuple[Array, Mask]:
    turn = quat_multiply(quat_conjugate(last), q)
    near = np.abs(turn[..., 0]) > np.cos(min(0.5 * max_turn_rad, 0.5 * np.pi)) + _CLEARLY
    if near.all():
        return q, ~near
    vector = rotation_vector_from_quat(turn)
    angle = np.sqrt((vector * vector).sum(axis=-1, keepdims=True))
    cut = angle > max_turn_rad
    shorter = vector * (max_turn_rad / np.maximum(angle, 1e-12))
    return np.where(cut, quat_multiply(last, quat_from_rotation_vector(shorter)), q), cut[..., 0]


def _inside_cone(q: Array, max_tilt_rad: float) -> tuple[Array, Mask]:
    """Turn back along the shortest way to the cone, about the horizontal axis the vehicle is tilted around."""
    up = up_axis(q)
    x, y, z = parts(up)
    horizontal = np.sqrt(x * x + y * y)
    tilt = np.arctan2(horizontal, z)
    cut = tilt > max_tilt_rad
    if not cut.any():
        return q, cut
    # exactly inverted there is no shortest way: any horizontal axis will do
    axis = np.where((horizontal > 1e-9)[..., None], _tilt_axis(up, horizontal), np.array([1.0, 0.0, 0.0]))
    back = quat_from_rotation_vector(axis * (max_tilt_rad - tilt)[..., None])
    return np.where(cut[..., None], quat_multiply(back, q), q), cut


def _tilt_axis(up: Array, horizontal: Array) -> Array:
    """Horizontal unit axis about which level was tilted to `up`: e3 x up."""
    size = np.maximum(horizontal, 1e-9)
    return np.stack((-up[..., 1] / size, up[..., 0] / size, np.zeros_like(size)), axis=-1)
