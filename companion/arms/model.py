"""Model of the two arms: joints, lengths, masses, limits and the shapes they must not touch. Plain values.

Joint vectors are (..., 8): right shoulder pitch, elbow pitch, elbow roll, claw, then the same of the left arm.
All zero is both arms hanging straight down, claws closed. Both arms have the same signs, so equal numbers are mirror
images: positive pitch lifts the link forward, positive roll swings the forearm outward, a positive claw opens.
Body frame FLU, origin where motion capture has the vehicle's.
"""

from dataclasses import astuple, dataclass, field
from enum import StrEnum

import numpy as np

from companion.core.types import Array

JOINTS_PER_ARM = 4
CHAIN = 3
"""Joints of an arm that move its links; the fourth is the claw."""
JOINT_COUNT = 8


class Side(StrEnum):
    """Side of an arm; the paper's j = 1 is the right one."""

    RIGHT = "right"
    LEFT = "left"


SIDES = (Side.RIGHT, Side.LEFT)
KINDS = ("shoulder_pitch", "elbow_pitch", "elbow_roll", "claw")
JOINT_NAMES = tuple(f"{side}.{kind}" for side in SIDES for kind in KINDS)
CLAWS = (3, 7)
"""Places of the claws in a joint vector."""


@dataclass(frozen=True)
class Link:
    """One link of an arm."""

    length_m: float
    mass_kg: float
    com_m: float
    """Centre of mass, from the link's upper end along it."""


@dataclass(frozen=True)
class JointLimit:
    """Limits of a joint's angle, velocity and acceleration."""

    min_rad: float
    max_rad: float
    max_velocity_radps: float
    max_accel_radps2: float


@dataclass(frozen=True)
class Propellers:
    """Discs in which nothing may be; all at one height, evenly around the body."""

    count: int = 4
    radius_m: float = 0.17
    """Radius of one disc."""
    centre_m: float = 0.33
    """Distance from the body's axis to the centre of a disc."""
    first_rad: float = 0.7854
    """Direction of the first disc's centre from body x, about body z."""
    height_m: float = 0.06
    """Above the body's origin."""


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """Both arms and what is around them; the defaults carry the paper's lengths (section 5)."""

    links: tuple[Link, Link, Link] = (Link(0.15, 0.14, 0.11), Link(0.05, 0.10, 0.03), Link(0.17, 0.16, 0.09))
    """Upper arm L_1, elbow L_2 (between pitch and roll axis), forearm with claw L_3."""
    shoulder_flu_m: tuple[float, float, float] = (0.0, 0.13, -0.08)
    """The left arm's first axis; the right one's has the opposite y."""
    limits: tuple[JointLimit, JointLimit, JointLimit, JointLimit] = (
        JointLimit(-1.57, 1.57, 3.0, 20.0),
        JointLimit(-0.2, 2.6, 3.0, 20.0),
        JointLimit(-0.6, 1.2, 3.0, 20.0),
        JointLimit(0.0, 1.0, 4.0, 30.0),
    )
    link_radius_m: float = 0.025
    body_half_flu_m: tuple[float, float, float] = (0.14, 0.09, 0.06)
    """Half the sides of the box that holds frame, battery and computer, centred on the body's origin."""
    propellers: Propellers = field(default_factory=Propellers)
    margin_m: float = 0.02
    """Least distance that is kept between any two of these."""

    def shoulders_flu_m(self) -> Array:
        """Return the first axes, right then left, (2, 3)."""
        x, y, z = self.shoulder_flu_m
        return np.array([[x, -y, z], [x, y, z]])

    def limit_arrays(self) -> tuple[Array, Array, Array, Array]:
        """Return least and largest angle (rad), velocity (rad/s) and acceleration (rad/s^2), each (8,)."""
        low, high, velocity, acceleration = np.array([astuple(limit) for limit in (*self.limits, *self.limits)]).T
        return low, high, velocity, acceleration
