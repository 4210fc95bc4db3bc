"""From the commanded force and heading to attitude and normalised thrust, and back.

U_c = m_t (u + g e_3) in W; a multirotor can only push along its own z axis, so the attitude turns that axis along the
force, the heading fixes the rest, and the thrust is the force's size.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.control.components import chosen, joined, maths, parts
from companion.control.frames import up_axis
from companion.control.switching import norm_squared
from companion.types import Array, AttitudeThrust

MIN_FORCE_N = 1e-3
"""Below this a force has no direction worth following."""
_UP = np.array([0.0, 0.0, 1.0])
_NOT_DOWN = np.array([-np.inf, -np.inf, 0.0])


@dataclass(frozen=True)
class ThrustModel:
    """How much force a normalised thrust gives. `curve` is PX4's THR_MDL_FAC when the autopilot does not correct it."""

    mass_kg: float = 4.85
    gravity_mps2: float = 9.8
    hover_thrust: float = 0.5
    """Normalised thrust that carries the weight (MPC_THR_HOVER)."""
    curve: float = 0.0
    """f in force/force_max = f t^2 + (1 - f) t, 0..1."""

    @property
    def max_force_n(self) -> float:
        """Force at full thrust."""
        h, f = self.hover_thrust, self.curve
        return self.mass_kg * self.gravity_mps2 / (f * h * h + (1.0 - f) * h)


def force_of_accel(accel_w_mps2: Array, model: ThrustModel) -> Array:
    """U_c = m_t (u + g e_3) (N), shape (..., 3)."""
    return np.asarray(model.mass_kg * (accel_w_mps2 + model.gravity_mps2 * _UP))


def within_tilt(accel_w_mps2: Array, max_tilt_rad: float, gravity_mps2: float) -> Array:
    """u with its horizontal part cut so that the vehicle need not tilt further (m/s^2), shape (..., 3).

    The height comes first: turning the whole force back into the cone, as the gate does, would make the vehicle climb.
    """
    lift = np.maximum(accel_w_mps2[..., 2:] + gravity_mps2, 0.0)
    across = accel_w_mps2[..., :2]
    most = np.tan(max_tilt_rad) * lift
    size = np.sqrt((across * across).sum(axis=-1, keepdims=True))
    if (size <= most).all():
        return accel_w_mps2
    cut = across * np.minimum(1.0, most / np.maximum(size, 1e-12))
    return np.concatenate((cut, accel_w_mps2[..., 2:]), axis=-1)


def thrust_axis(force_w_n: Array) -> Array:
    """Unit axis in W along which the rotors must push, shape (..., 3).

    No force has no direction: level. A force that points down would turn the vehicle over: its horizontal part is
    followed (the limits cut the tilt), and with none the vehicle stays level.
    """
    upper = np.maximum(force_w_n, _NOT_DOWN)
    size = np.sqrt(norm_squared(upper))
    if (size > MIN_FORCE_N).all():
        return np.asarray(upper / size)
    return np.where(size > MIN_FORCE_N, upper / np.maximum(size, MIN_FORCE_N), _UP)


def attitude_of(axis_w: Array, yaw_rad: Array | float) -> Array:
    """Quaternion W<-FLU with body z along `axis_w` and the nose towards `yaw_rad`, shape (..., 4), w >= 0.

    The heading, then a turn about the left that brings the nose down, then one about the nose: aerospace angles. With
    the axis horizontal along the heading's left the nose has no direction left: it points up.
    """
    (x, y, z), turn = parts(axis_w), maths(yaw_rad)
    m, (sine, cosine) = maths(x), (turn.sin(yaw_rad), turn.cos(yaw_rad))
    ahead, left = cosine * x + sine * y, cosine * y - sine * x
    upright = m.sqrt(ahead * ahead + z * z)
    nose_down = chosen(upright > 1e-6, m.atan2(ahead, z), -0.5 * np.pi)
    lean = m.atan2(-left, upright)
    return _of_turns(0.5 * yaw_rad, 0.5 * nose_down, 0.5 * lean)


def _of_turns(half_yaw: Any, half_pitch: Any, half_roll: Any) -> Array:
    """Quaternion of turns about z, the new y and the new x, given as half angles; w >= 0."""
    m, turn = maths(half_pitch), maths(half_yaw)
    (cz, sz), (cy, sy) = (turn.cos(half_yaw), turn.sin(half_yaw)), (m.cos(half_pitch), m.sin(half_pitch))
    cx, sx = m.cos(half_roll), m.sin(half_roll)
    w = cx * cy * cz + sx * sy * sz
    x = sx * cy * cz - cx * sy * sz
    y = cx * sy * cz + sx * cy * sz
    z = cx * cy * sz - sx * sy * cz
    sign = chosen(w < 0.0, -1.0, 1.0)
    return joined(sign * w, sign * x, sign * y, sign * z)


def normalised_thrust(collective_n: Array, model: ThrustModel) -> Array:
    """Thrust 0..1 (unclipped above) whose force is `collective_n`; negative forces give 0, shape as given."""
    ratio = np.maximum(collective_n, 0.0) / model.max_force_n
    f = model.curve
    if f < 1e-9:
        return np.asarray(ratio)
    return np.asarray((np.sqrt((1.0 - f) ** 2 + 4.0 * f * ratio) - (1.0 - f)) / (2.0 * f))


def collective_force_n(thrust: Array, model: ThrustModel) -> Array:
    """Inverse of `normalised_thrust` (N), shape as given."""
    f = model.curve
    return np.asarray(model.max_force_n * (f * thrust * thrust + (1.0 - f) * thrust))


def setpoint_of_accel(accel_w_mps2: Array, yaw_rad: Array | float, model: ThrustModel) -> AttitudeThrust:
    """Attitude and thrust that give u, or the nearest that can be flown."""
    force = force_of_accel(accel_w_mps2, model)
    axis = thrust_axis(force)
    thrust = normalised_thrust((force * axis).sum(axis=-1), model)
    return AttitudeThrust(attitude_of(axis, yaw_rad), thrust)


def accel_of_setpoint(setpoint: AttitudeThrust, model: ThrustModel) -> Array:
    """u that a setpoint asks for (m/s^2), shape (..., 3): what was really sent, in the law's terms."""
    force = collective_force_n(setpoint.thrust, model)[..., None] * up_axis(setpoint.q_w_flu_wxyz)
    return np.asarray(force / model.mass_kg - model.gravity_mps2 * _UP)
