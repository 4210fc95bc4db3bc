"""Numbers of a planned arm motion: speeds, accelerations, least clearance. Pure."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from companion.arms.collision import distances
from companion.arms.model import ArmModel
from companion.arms.sampling import samples
from companion.arms.trajectory import JointTrajectory
from companion.core.types import Array, JointMotion

_MOST_POSES = 12_000
"""Clearances worked out; a longer motion is looked at in wider steps (the planner has seen all of it)."""
_CHUNK = 512


@dataclass(frozen=True)
class Nearest:
    """The tightest moment of a motion."""

    time_s: float
    distance_m: float
    what: str
    """Names of the pair, such as "left forearm and a propeller"."""


@dataclass(frozen=True)
class MotionNumbers:
    """A motion from its first to its last moment."""

    time_s: Array
    """(n,)."""
    motion: JointMotion
    """(n, 8)."""
    clearance_time_s: Array
    """(m,), as many of them as are worth while."""
    clearance_m: Array
    """(m,), of the nearest pair; negative when they overlap."""
    nearest: Nearest

    @property
    def duration_s(self) -> float:
        """The duration of the motion, s."""
        return float(self.time_s[-1])

    @cached_property
    def fastest_radps(self) -> Array:
        """Largest speed of each joint, (8,)."""
        return np.asarray(np.abs(self.motion.velocity_radps).max(axis=0))

    @cached_property
    def sharpest_radps2(self) -> Array:
        """Largest acceleration of each joint, (8,)."""
        return np.asarray(np.abs(self.motion.acceleration_radps2).max(axis=0))


def numbers_of(model: ArmModel, trajectory: JointTrajectory, floor_z_m: float | None = None) -> MotionNumbers:
    """Look at all of a motion; `floor_z_m` is the floor's height in the body frame of a level vehicle."""
    looked = samples(trajectory)
    step = max(1, -(-len(looked.time_s) // _MOST_POSES))
    rows = np.unique(np.append(np.arange(0, len(looked.time_s), step), len(looked.time_s) - 1))
    poses = looked.motion.position_rad[rows]
    found = [distances(model, poses[at : at + _CHUNK], floor_z_m) for at in range(0, len(rows), _CHUNK)]
    apart_m = np.concatenate([part.distance_m for part in found])
    row, pair = np.unravel_index(int(np.argmin(apart_m)), apart_m.shape)
    nearest = Nearest(float(looked.time_s[rows[row]]), float(apart_m[row, pair]), found[0].what[int(pair)])
    return MotionNumbers(looked.time_s, looked.motion, looked.time_s[rows], apart_m.min(axis=-1), nearest)
