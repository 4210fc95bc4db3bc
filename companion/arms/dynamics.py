"""Effects of the links' masses on the vehicle: centre of mass, momentum, reaction force and torque. Body FLU.

Each link is a point mass at its centre of mass; claws move no mass. The vehicle itself does not turn: what its turning
adds (Coriolis, Euler, centrifugal) is small beside this and left to the controller (docs/arms-geometry.md). With the
links' directions u, e, f of `kinematics`, an arm's first moment of mass is

    sum_i m_i r_i = (m_1 + m_2 + m_3) r_shoulder + k_1 u + k_2 e + k_3 f
    k_1 = m_1 c_1 + (m_2 + m_3) L_1,   k_2 = m_2 c_2 + m_3 L_2,   k_3 = m_3 c_3

and its first and second derivatives are the momentum and minus the force on the vehicle.
"""

import numpy as np

from companion.arms.kinematics import OUTWARD, by_arm, link_directions
from companion.arms.model import ArmModel
from companion.arms.one_motion import one_force_b_n, one_torque_b_nm
from companion.core.types import Array, JointMotion


def link_com_flu_m(model: ArmModel, joints_rad: Array) -> Array:
    """Centres of mass of the links, (..., 2 arms, 3 links, 3), m; joints (..., 8)."""
    return model.shoulders_flu_m()[:, None, :] + _levers(model) @ link_directions(joints_rad)


def arms_com_flu_m(model: ArmModel, joints_rad: Array) -> Array:
    """Centre of mass of both arms together, (..., 3), m; ValueError when the model's arms have no mass."""
    masses = _masses(model)
    if masses.sum() <= 0.0:
        raise ValueError("arms without mass have no centre of mass")
    return np.asarray(_moment_kgm(model, joints_rad) / (2.0 * masses.sum()))


def com_shift_flu_m(model: ArmModel, joints_rad: Array, total_mass_kg: float) -> Array:
    """Return the shift of the whole vehicle's centre of mass from the body's origin, (..., 3), m.

    `total_mass_kg` is the paper's m_t, arms included; without its arms the vehicle is balanced on the origin.
    """
    return np.asarray(_moment_kgm(model, joints_rad) / total_mass_kg)


def momentum_b_ns(model: ArmModel, motion: JointMotion) -> Array:
    """Linear momentum of the links relative to the body, (..., 3), N s."""
    _, velocity, _ = link_com_motion(model, motion)
    return np.asarray((_masses(model)[:, None] * velocity).sum((-3, -2)))


def link_com_motion(model: ArmModel, motion: JointMotion) -> tuple[Array, Array, Array]:
    """Place (m), velocity (m/s) and acceleration (m/s^2) of the links' centres, each (..., 2, 3, 3), from the body."""
    rate, accel = _direction_rates(motion)
    levers = _levers(model)
    return link_com_flu_m(model, motion.position_rad), levers @ rate, levers @ accel


def reaction_torque_b_nm(model: ArmModel, motion: JointMotion) -> Array:
    """Torque of the moving links on the vehicle about the body's origin, - sum m r x r'', (..., 3), N m.

    Their weight is not in it: that is `com_shift_flu_m` times the thrust.
    """
    if motion.position_rad.ndim == 1:
        return one_torque_b_nm(model, motion)
    place, _, accel = link_com_motion(model, motion)
    return np.asarray(-(_masses(model)[:, None] * np.cross(place, accel)).sum((-3, -2)))


def reaction_force_b_n(model: ArmModel, motion: JointMotion) -> Array:
    """Force of the moving links on the vehicle, - d/dt of their momentum, (..., 3), N, body FLU.

    Minus the paper's F_m in the body frame.
    """
    if motion.position_rad.ndim == 1:
        return one_force_b_n(model, motion)
    _, _, accel = link_com_motion(model, motion)
    return np.asarray(-(_masses(model)[:, None] * accel).sum((-3, -2)))


def _masses(model: ArmModel) -> Array:
    return np.array([link.mass_kg for link in model.links])


def _levers(model: ArmModel) -> Array:
    """Row i times the directions is the way from the shoulder to link i's centre of mass."""
    one, two, three = model.links
    return np.array([[one.com_m, 0.0, 0.0], [one.length_m, two.com_m, 0.0], [one.length_m, two.length_m, three.com_m]])


def _moment_kgm(model: ArmModel, joints_rad: Array) -> Array:
    return np.asarray((_masses(model)[:, None] * link_com_flu_m(model, joints_rad)).sum((-3, -2)))


def _direction_rates(motion: JointMotion) -> tuple[Array, Array]:
    """First and second derivatives of the links' directions, (..., 2, 3, 3)."""
    a, b, r = np.moveaxis(by_arm(motion.position_rad), -1, 0)
    a1, b1, r1 = np.moveaxis(by_arm(motion.velocity_radps), -1, 0)
    a2, b2, r2 = np.moveaxis(by_arm(motion.acceleration_radps2), -1, 0)
    rate, accel = np.zeros((*a.shape, 3, 3)), np.zeros((*a.shape, 3, 3))
    _, rate[..., 0, :], accel[..., 0, :] = _in_plane(a, a1, a2)
    at, rate[..., 1, :], accel[..., 1, :] = _in_plane(a + b, a1 + b1, a2 + b2)
    c, c1, c2 = _cosine(r, r1, r2)
    rate[..., 2, :] = c1 * at + c * rate[..., 1, :]
    accel[..., 2, :] = c2 * at + 2.0 * c1 * rate[..., 1, :] + c * accel[..., 1, :]
    rate[..., 2, 1] = OUTWARD * np.cos(r) * r1
    accel[..., 2, 1] = OUTWARD * (np.cos(r) * r2 - np.sin(r) * r1 * r1)
    return rate, accel


def _in_plane(q: Array, q1: Array, q2: Array) -> tuple[Array, Array, Array]:
    """The direction that is down at 0 and forward at a quarter turn, and its derivatives, (..., 3)."""
    nothing = np.zeros_like(q)
    at = np.stack((np.sin(q), nothing, -np.cos(q)), axis=-1)
    along = np.stack((np.cos(q), nothing, np.sin(q)), axis=-1)
    return at, q1[..., None] * along, q2[..., None] * along - (q1 * q1)[..., None] * at


def _cosine(r: Array, r1: Array, r2: Array) -> tuple[Array, Array, Array]:
    """cos r and its derivatives, (..., 1)."""
    c, s = np.cos(r), np.sin(r)
    return c[..., None], (-s * r1)[..., None], (-c * r1 * r1 - s * r2)[..., None]
