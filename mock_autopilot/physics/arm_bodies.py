"""Two arms as six moving point masses under the vehicle, and the sums of their motion. Body frame FRD.

Hanging straight down at zero; positive pitch lifts a link forward, positive roll swings a forearm outward. Stepped with
the physics at 500 Hz, hence written out in floats instead of numpy on small vectors, and kept in tuples, which are made
in a third of a dataclass's time. Where a float is asked for, an array of them does as well: then it is many instants,
or many vehicles, at once.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mock_autopilot.physics.components import maths
from mock_autopilot.physics.plant import GRAVITY_MPS2
from mock_autopilot.physics.quaternion import Array

Three = tuple[float, float, float]

JOINTS_PER_ARM = 4
"""Shoulder pitch, elbow pitch, elbow roll, claw; the claw moves no mass worth counting."""


@dataclass(frozen=True)
class ArmBodies:
    """Lengths, masses and places; links are upper arm, elbow and forearm with claw."""

    link_length_m: Three = (0.15, 0.05, 0.17)
    """The paper's L_1, L_2, L_3."""
    link_mass_kg: Three = (0.14, 0.10, 0.16)
    """Masses, servos included."""
    link_com_m: Three = (0.11, 0.03, 0.09)
    """Centre of mass from the link's upper end."""
    shoulder_frd_m: Three = (0.0, 0.13, 0.08)
    """The right arm's first axis; the left one's has the opposite y."""


class JointState(NamedTuple):
    """One arm's pitch, pitch and roll: angle (rad), rate (rad/s), acceleration (rad/s^2)."""

    angle: Three
    rate: Three
    accel: Three


class Moving(NamedTuple):
    """Sums over the masses, relative to the body: m r (kg m), m r' (N s), m r'' (N), r x m r'' (N m)."""

    moment: Three
    momentum: Three
    force: Three
    torque: Three


class _Direction(NamedTuple):
    """A unit vector that turns with the joints, and its first two derivatives."""

    at: Three
    rate: Three
    accel: Three


def arm_motion(bodies: ArmBodies, joints: JointState, outward: float) -> Moving:
    """Return one arm's sums; `outward` is +1 for the right arm (FRD y points right) and -1 for the left one."""
    (l1, l2, _), (m1, m2, m3), (c1, c2, c3) = bodies.link_length_m, bodies.link_mass_kg, bodies.link_com_m
    upper, elbow, fore = _directions(joints, outward)
    x, y, z = bodies.shoulder_frd_m
    shoulder = (x, outward * y, z)
    a, b, c = m1 * c1 + (m2 + m3) * l1, m2 * c2 + m3 * l2, m3 * c3  # first moments along the three directions
    mass = m1 + m2 + m3
    moment = _mix(a, upper.at, b, elbow.at, c, fore.at)
    tx = ty = tz = 0.0
    for m, (i, j, k) in ((m1, (c1, 0.0, 0.0)), (m2, (l1, c2, 0.0)), (m3, (l1, l2, c3))):
        place = _mix(i, upper.at, j, elbow.at, k, fore.at)
        accel = _mix(i, upper.accel, j, elbow.accel, k, fore.accel)
        px, py, pz = cross((shoulder[0] + place[0], shoulder[1] + place[1], shoulder[2] + place[2]), accel)
        tx, ty, tz = tx + m * px, ty + m * py, tz + m * pz
    return Moving(
        (moment[0] + mass * shoulder[0], moment[1] + mass * shoulder[1], moment[2] + mass * shoulder[2]),
        _mix(a, upper.rate, b, elbow.rate, c, fore.rate),
        _mix(a, upper.accel, b, elbow.accel, c, fore.accel),
        (tx, ty, tz),
    )


def gravity_load_nm(bodies: ArmBodies, angle: Three) -> Three:
    """Return the torque (N m) of the links' weight on each joint of an arm, positive in the joint's own sense."""
    (l1, l2, _), (m1, m2, m3), (c1, c2, c3) = bodies.link_length_m, bodies.link_mass_kg, bodies.link_com_m
    a, s, r = angle[0], angle[0] + angle[1], angle[2]
    with_sin, with_cos = maths(s).sin(s), maths(s).cos(s)
    below = (m2 * c2 + m3 * l2) * with_sin + m3 * c3 * with_sin * maths(r).cos(r)
    all_of_it = (m1 * c1 + (m2 + m3) * l1) * maths(a).sin(a) + below
    roll = m3 * c3 * with_cos * maths(r).sin(r)
    return -GRAVITY_MPS2 * all_of_it, -GRAVITY_MPS2 * below, -GRAVITY_MPS2 * roll


def add(a: Moving, b: Moving) -> Moving:
    """Return the sum of two arms' moments, momenta, forces and torques."""
    return Moving(
        _plus(a.moment, b.moment), _plus(a.momentum, b.momentum), _plus(a.force, b.force), _plus(a.torque, b.torque)
    )


def cross(a: Three, b: Three) -> Three:
    """Return the vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _directions(joints: JointState, outward: float) -> tuple[_Direction, _Direction, _Direction]:
    """Return the directions of upper arm, elbow link and forearm."""
    (a, b, r), (a1, b1, r1), (a2, b2, r2) = joints.angle, joints.rate, joints.accel
    upper, elbow = _in_plane(a, a1, a2), _in_plane(a + b, a1 + b1, a2 + b2)
    c, s = _circle(r)
    c1, s1 = -s * r1, c * r1
    c2, s2 = -c * r1 * r1 - s * r2, -s * r1 * r1 + c * r2
    (ex, _, ez), (fx, _, fz), (gx, _, gz) = elbow.at, elbow.rate, elbow.accel
    fore = _Direction(
        (c * ex, outward * s, c * ez),
        (c1 * ex + c * fx, outward * s1, c1 * ez + c * fz),
        (c2 * ex + 2.0 * c1 * fx + c * gx, outward * s2, c2 * ez + 2.0 * c1 * fz + c * gz),
    )
    return upper, elbow, fore


def _in_plane(angle: float, rate: float, accel: float) -> _Direction:
    """Return the direction of a link in the pitch plane: down at zero, forward at a quarter turn."""
    c, s = _circle(angle)
    turn = rate * rate
    return _Direction((s, 0.0, c), (c * rate, 0.0, -s * rate), (c * accel - s * turn, 0.0, -s * accel - c * turn))


def _circle(angle: float | Array) -> tuple[Any, Any]:
    """Return cosine and sine of an angle (rad), a float or an array."""
    return (np.cos(angle), np.sin(angle)) if isinstance(angle, np.ndarray) else (math.cos(angle), math.sin(angle))


def _plus(a: Three, b: Three) -> Three:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _mix(i: float, a: Three, j: float, b: Three, k: float, c: Three) -> Three:
    return i * a[0] + j * b[0] + k * c[0], i * a[1] + j * b[1] + k * c[1], i * a[2] + j * b[2] + k * c[2]
