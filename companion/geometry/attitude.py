"""Conversion of a commanded force and heading to attitude and normalised thrust, and back.

U_c = m_t (u + g e_3) in W; a multirotor can only push along its own z axis, so the attitude turns that axis along the
force, the heading fixes the rest, and the thrust is the force's size.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np

from companion.core.paper_vehicle import GRAVITY_MPS2, MASS_KG
from companion.core.types import Array, AttitudeThrust, Scalar
from companion.geometry.array_math import any_true, item, math_module, maximum, minimum, stack, unstack, where
from companion.geometry.frames import up_axis_parts

MIN_FORCE_N = 1e-3
"""Force below which the direction is ignored."""


@dataclass(frozen=True)
class ThrustModel:
    """Force of a normalised thrust. `curve` is PX4's THR_MDL_FAC when the autopilot does not compensate for it."""

    mass_kg: float = MASS_KG
    gravity_mps2: float = GRAVITY_MPS2
    hover_thrust: float = 0.5
    """Normalised thrust that carries the weight (MPC_THR_HOVER)."""
    curve: float = 0.0
    """f in force/force_max = f t^2 + (1 - f) t, 0..1."""

    @cached_property
    def max_force_n(self) -> float:
        """Force at full thrust, N."""
        h, f = self.hover_thrust, self.curve
        return self.mass_kg * self.gravity_mps2 / (f * h * h + (1.0 - f) * h)


def force_of_accel(accel_w_mps2: Array, model: ThrustModel) -> Array:
    """Return U_c = m_t (u + g e_3) (N), shape (..., 3)."""
    x, y, z = unstack(accel_w_mps2)
    return stack(model.mass_kg * x, model.mass_kg * y, model.mass_kg * (z + model.gravity_mps2))


def limit_tilt(accel_w_mps2: Array, max_tilt_rad: float, gravity_mps2: float) -> Array:
    """Return u with its horizontal part cut to what the tilt limit allows (m/s^2), shape (..., 3).

    Height has priority: turning the whole force back into the cone, as limit_setpoint does, would make the vehicle
    climb.
    """
    x, y, z = unstack(accel_w_mps2)
    most = math_module(max_tilt_rad).tan(max_tilt_rad) * maximum(z + gravity_mps2, 0.0)
    size = math_module(x).sqrt(x * x + y * y)
    if not any_true(size > most):
        return accel_w_mps2
    share = minimum(1.0, most / maximum(size, 1e-12))
    return stack(share * x, share * y, z)


def thrust_axis(x: Scalar, y: Scalar, z: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Return the unit axis in W along which the rotors must push, from the force's components (N).

    No force has no direction: level. A force that points down would turn the vehicle over: its horizontal part is
    followed (the limits cut the tilt), and with none the vehicle stays level.
    """
    up = maximum(z, 0.0)
    size = math_module(x).sqrt(x * x + y * y + up * up)
    none = size <= MIN_FORCE_N
    if any_true(none):
        size, x, y, up = (where(none, level, part) for level, part in ((1.0, size), (0.0, x), (0.0, y), (1.0, up)))
    return x / size, y / size, up / size


def attitude_of(x: Scalar, y: Scalar, z: Scalar, yaw_rad: Scalar) -> Array:
    """Return the quaternion W<-FLU with body z along (x, y, z) in W and the nose towards `yaw_rad`, (..., 4), w >= 0.

    Turns by the heading, then about the left axis (nose down), then about the nose: aerospace angles. With the axis
    horizontal, along the left of the heading, the direction of the nose is undefined: it points up.
    """
    m, turn = math_module(x), math_module(yaw_rad)
    sine, cosine = turn.sin(yaw_rad), turn.cos(yaw_rad)
    ahead, left = cosine * x + sine * y, cosine * y - sine * x
    upright = m.sqrt(ahead * ahead + z * z)
    nose_down = where(upright > 1e-6, m.atan2(ahead, z), -0.5 * math.pi)
    lean = m.atan2(-left, upright)
    return _of_turns(0.5 * yaw_rad, 0.5 * nose_down, 0.5 * lean)


def _of_turns(half_yaw: Scalar, half_pitch: Scalar, half_roll: Scalar) -> Array:
    """Return the quaternion of turns about z, the new y and the new x, given as half angles; w >= 0."""
    m, turn = math_module(half_pitch), math_module(half_yaw)
    (cz, sz), (cy, sy) = (turn.cos(half_yaw), turn.sin(half_yaw)), (m.cos(half_pitch), m.sin(half_pitch))
    cx, sx = m.cos(half_roll), m.sin(half_roll)
    w = cx * cy * cz + sx * sy * sz
    x = sx * cy * cz - cx * sy * sz
    y = cx * sy * cz + sx * cy * sz
    z = cx * cy * sz - sx * sy * cz
    sign = where(w < 0.0, -1.0, 1.0)
    return stack(sign * w, sign * x, sign * y, sign * z)


def normalised_thrust(collective_n: Scalar, model: ThrustModel) -> Scalar:
    """Return the thrust 0..1 (unclipped above) whose force is `collective_n`, float or (...,); negative ones give 0."""
    ratio = maximum(collective_n, 0.0) / model.max_force_n
    f = model.curve
    linear = f < 1e-9
    if linear is True:
        return ratio
    curved = (math_module(ratio).sqrt((1.0 - f) ** 2 + 4.0 * f * ratio) - (1.0 - f)) / (2.0 * maximum(f, 1e-9))
    return where(linear, ratio, curved)


@overload
def collective_force_n(thrust: float, model: ThrustModel) -> float: ...
@overload
def collective_force_n(thrust: Scalar, model: ThrustModel) -> Scalar: ...
def collective_force_n(thrust: Scalar, model: ThrustModel) -> Scalar:
    """Return the force of a thrust (N), the inverse of `normalised_thrust`; a float or (...,)."""
    f = model.curve
    return model.max_force_n * (f * thrust * thrust + (1.0 - f) * thrust)


def setpoint_of_accel(accel_w_mps2: Array, yaw_rad: Scalar, model: ThrustModel) -> AttitudeThrust:
    """Return the attitude and thrust that give u, or the nearest that can be flown."""
    x, y, z = unstack(force_of_accel(accel_w_mps2, model))
    axis_x, axis_y, axis_z = thrust_axis(x, y, z)
    thrust = normalised_thrust(x * axis_x + y * axis_y + z * axis_z, model)
    return AttitudeThrust(attitude_of(axis_x, axis_y, axis_z, yaw_rad), np.asarray(thrust))


def accel_of_setpoint(setpoint: AttitudeThrust, model: ThrustModel) -> Array:
    """Return u of a setpoint (m/s^2), shape (..., 3): the command that was really sent, in the units of the law."""
    push = collective_force_n(item(setpoint.thrust), model) / model.mass_kg
    x, y, z = up_axis_parts(setpoint.q_w_flu_wxyz)
    return stack(push * x, push * y, push * z - model.gravity_mps2)
