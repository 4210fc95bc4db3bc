"""Effects of the links' masses on the vehicle: centre of mass, reaction force and torque. Body FLU.

Each link is a point mass at its centre of mass; claws move no mass. The vehicle itself does not turn: what its turning
adds (Coriolis, Euler, centrifugal) is small beside this and left to the controller (docs/arms-geometry.md). With the
links' directions u, e, f of `kinematics`, an arm's first moment of mass is

    sum_i m_i r_i = (m_1 + m_2 + m_3) r_shoulder + k_1 u + k_2 e + k_3 f
    k_1 = m_1 c_1 + (m_2 + m_3) L_1,   k_2 = m_2 c_2 + m_3 L_2,   k_3 = m_3 c_3

whose second derivative is minus the force on the vehicle. Force and torque are computed by components: on plain floats
for the one motion of a tick, which numpy's vectors of three would cost 100 us, and on arrays for many motions.
"""

from collections.abc import Iterator

import numpy as np

from companion.arms.kinematics import link_directions
from companion.arms.model import JOINTS_PER_ARM, ArmModel
from companion.core.types import Array, JointMotion, Scalar
from companion.geometry.array_math import math_module, stack, unstack

_Plane = tuple[Scalar, Scalar]
_ARMS = ((0, -1.0), (JOINTS_PER_ARM, 1.0))
"""First joint and outward direction along body y; right, left."""


def link_com_flu_m(model: ArmModel, joints_rad: Array) -> Array:
    """Return the links' centres of mass, (..., 2 arms, 3 links, 3), m; joints (..., 8)."""
    levers = np.array([along for _, *along in _levers(model)])
    return model.shoulders_flu_m()[:, None, :] + levers @ link_directions(joints_rad)


def com_shift_flu_m(model: ArmModel, joints_rad: Array, total_mass_kg: float) -> Array:
    """Return the shift of the whole vehicle's centre of mass from the body's origin, (..., 3), m.

    `total_mass_kg` is the paper's m_t, arms included; without its arms the vehicle is balanced on the origin.
    """
    masses = np.array([link.mass_kg for link in model.links])
    return np.asarray((masses[:, None] * link_com_flu_m(model, joints_rad)).sum((-3, -2)) / total_mass_kg)


def reaction_force_b_n(model: ArmModel, motion: JointMotion) -> Array:
    """Return the force of the moving links on the vehicle, - d/dt of their momentum, (..., 3), N, body FLU.

    Minus the paper's F_m in the body frame: the second derivative of k_1 u + (k_2 + k_3 cos r) e + k_3 o sin r y.
    """
    upper, elbow, forearm = model.links
    k1 = upper.mass_kg * upper.com_m + (elbow.mass_kg + forearm.mass_kg) * upper.length_m
    k2 = elbow.mass_kg * elbow.com_m + forearm.mass_kg * elbow.length_m
    k3 = forearm.mass_kg * forearm.com_m
    x: Scalar = 0.0
    y: Scalar = 0.0
    z: Scalar = 0.0
    for outward, (a, b, r), (a1, b1, r1), (a2, b2, r2) in _by_arm(motion):
        m, s1, s2 = math_module(a), a1 + b1, a2 + b2
        sin_a, cos_a, sin_s, cos_s = m.sin(a), m.cos(a), m.sin(a + b), m.cos(a + b)
        sin_r, cos_r = m.sin(r), m.cos(r)
        g, g1, g2 = k2 + k3 * cos_r, -k3 * sin_r * r1, -k3 * (cos_r * r1 * r1 + sin_r * r2)
        along, across = g2 - g * s1 * s1, 2.0 * g1 * s1 + g * s2
        x += k1 * (cos_a * a2 - sin_a * a1 * a1) + along * sin_s + across * cos_s
        y += outward * k3 * (cos_r * r2 - sin_r * r1 * r1)
        z += k1 * (sin_a * a2 + cos_a * a1 * a1) - along * cos_s + across * sin_s
    return stack(-x, -y, -z)


def reaction_torque_b_nm(model: ArmModel, motion: JointMotion) -> Array:
    """Return the torque of the moving links on the vehicle about the body's origin, - sum m r x r'', (..., 3), N m.

    Their weight is not in it: that is `com_shift_flu_m` times the thrust.
    """
    shoulder_x, shoulder_y, shoulder_z = model.shoulder_flu_m
    x: Scalar = 0.0
    y: Scalar = 0.0
    z: Scalar = 0.0
    for outward, angle, rate, accel in _by_arm(motion):
        m = math_module(angle[0])
        (ux, uz), (ux2, uz2) = _turning(angle[0], rate[0], accel[0], 1.0, 0.0, 0.0)
        roll = (m.cos(angle[2]), m.sin(angle[2]), rate[2], accel[2])
        pitch = (angle[0] + angle[1], rate[0] + rate[1], accel[0] + accel[1])
        for mass, upper, elbow, fore in _levers(model):
            reach, reach1, reach2, side, side2 = _rolled(elbow, fore, outward, roll)
            (ex, ez), (ex2, ez2) = _turning(*pitch, reach, reach1, reach2)
            px, py, pz = shoulder_x + upper * ux + ex, outward * shoulder_y + side, shoulder_z + upper * uz + ez
            qx, qy, qz = upper * ux2 + ex2, side2, upper * uz2 + ez2
            x += mass * (py * qz - pz * qy)
            y += mass * (pz * qx - px * qz)
            z += mass * (px * qy - py * qx)
    return stack(-x, -y, -z)


def _by_arm(motion: JointMotion) -> Iterator[tuple[float, list[Scalar], list[Scalar], list[Scalar]]]:
    """Yield each arm's outward direction, then angles, rates and accelerations of pitch, pitch and roll."""
    rows = [unstack(part) for part in (motion.position_rad, motion.velocity_radps, motion.acceleration_radps2)]
    for first, outward in _ARMS:
        angle, rate, accel = (row[first : first + 3] for row in rows)
        yield outward, angle, rate, accel


def _levers(model: ArmModel) -> tuple[tuple[float, float, float, float], ...]:
    """Return each link's mass (kg) and the distances (m) of its centre along upper arm, elbow and forearm."""
    upper, elbow, forearm = model.links
    return (
        (upper.mass_kg, upper.com_m, 0.0, 0.0),
        (elbow.mass_kg, upper.length_m, elbow.com_m, 0.0),
        (forearm.mass_kg, upper.length_m, elbow.length_m, forearm.com_m),
    )


def _turning(q: Scalar, q1: Scalar, q2: Scalar, g: Scalar, g1: Scalar, g2: Scalar) -> tuple[_Plane, _Plane]:
    """Return x and z of a length g in the arm's plane, down at q = 0, forward at a quarter turn, and of g''."""
    m = math_module(q)
    sine, cosine = m.sin(q), m.cos(q)
    along, across = g2 - g * q1 * q1, 2.0 * g1 * q1 + g * q2
    return (g * sine, -g * cosine), (along * sine + across * cosine, -along * cosine + across * sine)


def _rolled(elbow: float, fore: float, outward: float, roll: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
    """Return the length in the arm's plane with two derivatives, and the offset along body y with its second."""
    cosine, sine, r1, r2 = roll
    length2 = -fore * (cosine * r1 * r1 + sine * r2)
    side2 = outward * fore * (cosine * r2 - sine * r1 * r1)
    return elbow + fore * cosine, -fore * sine * r1, length2, outward * fore * sine, side2
