"""A joint trajectory looked at closely enough that nothing between the samples matters."""

from dataclasses import dataclass

import numpy as np

from companion.arms.collision import distances
from companion.arms.kinematics import by_arm
from companion.arms.model import ArmModel
from companion.arms.trajectory import JointTrajectory
from companion.core.types import Array, JointMotion

_PER_PIECE = 48
"""Samples of a piece. The peaks of a quintic's velocity and acceleration are then missed by at most 1 %."""
_LEAST_STEP_M = 0.005
"""Smallest movement of the links between two checks of their clearance."""
_COARSE = 8
"""Steps skipped where everything is far away."""
_CHUNK = 512
"""Poses whose distances are worked out at once; more do not fit into the processor's cache."""


@dataclass(frozen=True)
class Samples:
    """Times (n,), s, and the motion at each, (n, 8)."""

    time_s: Array
    motion: JointMotion


@dataclass(frozen=True)
class TooNear:
    """The first moment at which two things come nearer than they may."""

    time_s: float
    what: str
    distance_m: float
    keep_m: float


def samples(trajectory: JointTrajectory) -> Samples:
    """Return samples of the whole trajectory, each simple piece in the same number of steps."""
    ends = trajectory.pieces_s
    shares = np.arange(_PER_PIECE) / _PER_PIECE
    inside = ends[:-1, None] + np.diff(ends)[:, None] * shares
    time_s = np.append(inside.ravel(), ends[-1])
    return Samples(time_s, trajectory.at(time_s))


def first_too_near(
    model: ArmModel, trajectory: JointTrajectory, keep_m: float | Array, floor_z_m: float | None = None
) -> TooNear | None:
    """Return the first moment at which some pair is nearer than `keep_m`; None if none is.

    `keep_m` is one distance for all pairs, or one for each pair in the order of `clearance.distances`.

    The links travel at most half the margin between two looks, so nothing comes nearer than `keep_m` less a quarter of
    the margin. Where the distances at both ends of eight such steps leave no room for it, nobody looks between.
    """
    time_s, travel_m = _travel(model, samples(trajectory))
    step_m = max(0.5 * model.margin_m, _LEAST_STEP_M)
    count = _COARSE * int(np.ceil(travel_m[-1] / (_COARSE * step_m)))
    at_s = np.interp(np.linspace(0.0, travel_m[-1], count + 1), travel_m, time_s)
    coarse_s = at_s[::_COARSE]
    spare = _spare_m(model, trajectory, coarse_s, keep_m, floor_z_m)
    tight = 0.5 * (spare[:-1] + spare[1:] - _COARSE * step_m) < 0.0
    looked_s = np.append(at_s[:-1].reshape(-1, _COARSE)[tight].ravel(), coarse_s[spare < 0.0])
    return _first(model, trajectory, np.unique(looked_s), keep_m, floor_z_m)


def _first(
    model: ArmModel, trajectory: JointTrajectory, time_s: Array, keep_m: float | Array, floor_z_m: float | None
) -> TooNear | None:
    for begin in range(0, len(time_s), _CHUNK):
        chunk_s = time_s[begin : begin + _CHUNK]
        found = distances(model, trajectory.at(chunk_s).position_rad, floor_z_m)
        near = (found.distance_m < keep_m).any(-1)
        if near.any():
            row = int(np.argmax(near))
            kept_m = np.broadcast_to(keep_m, found.distance_m[row].shape)
            pair = int(np.argmin(found.distance_m[row] - kept_m))
            return TooNear(
                float(chunk_s[row]), found.what[pair], float(found.distance_m[row, pair]), float(kept_m[pair])
            )
    return None


def _spare_m(
    model: ArmModel, trajectory: JointTrajectory, time_s: Array, keep_m: float | Array, floor_z_m: float | None
) -> Array:
    """Return the least distance of any pair less its `keep_m` at each time, (n,), m."""
    parts = []
    for begin in range(0, len(time_s), _CHUNK):
        poses = trajectory.at(time_s[begin : begin + _CHUNK]).position_rad
        parts.append((distances(model, poses, floor_z_m).distance_m - keep_m).min(-1))
    return np.concatenate(parts)


def _travel(model: ArmModel, looked: Samples) -> tuple[Array, Array]:
    """Return times, and an upper bound of how far any point of both arms has moved until then, (n,) m.

    A joint moves no point faster than its rate times what hangs on it. A tenth is added for the trapezoids.
    """
    l1, l2, l3 = (link.length_m for link in model.links)
    levers = np.array([l1 + l2 + l3, l2 + l3, l3])
    speed = (np.abs(by_arm(looked.motion.velocity_radps)) @ levers).sum(-1)
    steps = 0.55 * (speed[:-1] + speed[1:]) * np.diff(looked.time_s)
    return looked.time_s, np.append(0.0, np.cumsum(steps))
