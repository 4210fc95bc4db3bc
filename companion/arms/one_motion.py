"""Reaction of a single joint motion (8,), in plain floats: numpy on vectors of three would cost the tick 100 us.

The equations are those of `mass`, which takes many motions at once; tests hold both against each other.
"""

import math
from collections.abc import Iterator

import numpy as np

from companion.arms.model import JOINTS_PER_ARM, ArmModel
from companion.core.types import Array, JointMotion

_Three = tuple[float, float, float]
_ARMS = ((0, -1.0), (JOINTS_PER_ARM, 1.0))
"""First joint and outward direction along body y; right, left."""


def one_force_b_n(model: ArmModel, motion: JointMotion) -> Array:
    """Force of the moving links on the vehicle, (3,), N, body FLU.

    The second derivative of k_1 u + (k_2 + k_3 cos r) e + k_3 o sin r y, written out.
    """
    one, two, three = model.links
    k1 = one.mass_kg * one.com_m + (two.mass_kg + three.mass_kg) * one.length_m
    k2 = two.mass_kg * two.com_m + three.mass_kg * two.length_m
    k3 = three.mass_kg * three.com_m
    x = y = z = 0.0
    for outward, (a, b, r), (a1, b1, r1), (a2, b2, r2) in _by_arm(motion):
        s1, s2 = a1 + b1, a2 + b2
        sin_a, cos_a, sin_s, cos_s = math.sin(a), math.cos(a), math.sin(a + b), math.cos(a + b)
        sin_r, cos_r = math.sin(r), math.cos(r)
        g, g1, g2 = k2 + k3 * cos_r, -k3 * sin_r * r1, -k3 * (cos_r * r1 * r1 + sin_r * r2)
        along, across = g2 - g * s1 * s1, 2.0 * g1 * s1 + g * s2
        x += k1 * (cos_a * a2 - sin_a * a1 * a1) + along * sin_s + across * cos_s
        y += outward * k3 * (cos_r * r2 - sin_r * r1 * r1)
        z += k1 * (sin_a * a2 + cos_a * a1 * a1) - along * cos_s + across * sin_s
    return np.array([-x, -y, -z])


def one_torque_b_nm(model: ArmModel, motion: JointMotion) -> Array:
    """Torque of the moving links on the vehicle about the body's origin, (3,), N m, body FLU."""
    shoulder_x, shoulder_y, shoulder_z = model.shoulder_flu_m
    x = y = z = 0.0
    for outward, angle, rate, accel in _by_arm(motion):
        (ux, _, uz), (ux2, _, uz2) = _turning(angle[0], rate[0], accel[0], 1.0, 0.0, 0.0)
        roll = (math.cos(angle[2]), math.sin(angle[2]), rate[2], accel[2])
        pitch = (angle[0] + angle[1], rate[0] + rate[1], accel[0] + accel[1])
        for mass, upper, elbow, fore in _levers(model):
            reach, reach1, reach2, side, side2 = _rolled(elbow, fore, outward, roll)
            (ex, _, ez), (ex2, _, ez2) = _turning(*pitch, reach, reach1, reach2)
            px, py, pz = shoulder_x + upper * ux + ex, outward * shoulder_y + side, shoulder_z + upper * uz + ez
            qx, qy, qz = upper * ux2 + ex2, side2, upper * uz2 + ez2
            x += mass * (py * qz - pz * qy)
            y += mass * (pz * qx - px * qz)
            z += mass * (px * qy - py * qx)
    return np.array([-x, -y, -z])


def _by_arm(motion: JointMotion) -> Iterator[tuple[float, _Three, _Three, _Three]]:
    """Outward direction; angles, rates and accelerations of pitch, pitch and roll."""
    rows = [part.tolist() for part in (motion.position_rad, motion.velocity_radps, motion.acceleration_radps2)]
    for first, outward in _ARMS:
        angle, rate, accel = ((row[first], row[first + 1], row[first + 2]) for row in rows)
        yield outward, angle, rate, accel


def _levers(model: ArmModel) -> tuple[tuple[float, float, float, float], ...]:
    """Return each link's mass (kg) and the distances (m) of its centre along upper arm, elbow and forearm."""
    one, two, three = model.links
    return (
        (one.mass_kg, one.com_m, 0.0, 0.0),
        (two.mass_kg, one.length_m, two.com_m, 0.0),
        (three.mass_kg, one.length_m, two.length_m, three.com_m),
    )


def _turning(q: float, q1: float, q2: float, g: float, g1: float, g2: float) -> tuple[_Three, _Three]:
    """A length g in the arm's plane, down at q = 0, forward at a quarter turn: itself and its second derivative."""
    sine, cosine = math.sin(q), math.cos(q)
    along, across = g2 - g * q1 * q1, 2.0 * g1 * q1 + g * q2
    return (g * sine, 0.0, -g * cosine), (along * sine + across * cosine, 0.0, -along * cosine + across * sine)


def _rolled(
    elbow: float, fore: float, outward: float, roll: tuple[float, float, float, float]
) -> tuple[float, float, float, float, float]:
    """Length in the arm's plane with two derivatives, and offset along body y with its second."""
    cosine, sine, r1, r2 = roll
    length2 = -fore * (cosine * r1 * r1 + sine * r2)
    side2 = outward * fore * (cosine * r2 - sine * r1 * r1)
    return elbow + fore * cosine, -fore * sine * r1, length2, outward * fore * sine, side2
