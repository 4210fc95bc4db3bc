"""Distances of the arms from each other, the body, the propellers and the floor.

Links are capsules of `link_radius_m`, the body a box, propellers thin discs. An arm is not compared with itself: the
elbow's limits keep its forearm off its upper arm, and the roll only swings it farther out. Nor is an upper arm with the
body, on which it is mounted; its lower end is also the elbow link's, and that is.
"""

from dataclasses import dataclass

import numpy as np

from companion.arms.kinematics import points_flu_m
from companion.arms.model import SIDES, ArmModel
from companion.arms.shapes import between_segments_m, to_box_m, to_discs_m
from companion.core.types import Array

LINKS = ("upper arm", "elbow", "forearm")
_PAIRS = tuple((i, j) for i in range(len(LINKS)) for j in range(len(LINKS)))


@dataclass(frozen=True)
class Clearance:
    """The nearest two things; negative when they overlap."""

    distance_m: float
    what: str
    """Names of the pair, such as "left forearm and a propeller"."""


@dataclass(frozen=True)
class Distances:
    """Between the surfaces of all pairs, (..., pairs), m."""

    distance_m: Array
    what: tuple[str, ...]


def clearance(model: ArmModel, joints_rad: Array, floor_z_m: float | None = None) -> Clearance:
    """Return the nearest pair at one pose (8,); `floor_z_m` is the floor's height in the level body's frame."""
    found = distances(model, joints_rad, floor_z_m)
    pair = int(np.argmin(found.distance_m))
    return Clearance(float(found.distance_m[pair]), found.what[pair])


def distances(model: ArmModel, joints_rad: Array, floor_z_m: float | None = None) -> Distances:
    """Return the distances of all pairs at poses (..., 8)."""
    points = points_flu_m(model, joints_rad)
    start, end = points[..., :-1, :], points[..., 1:, :]
    columns = [
        _between_arms(start, end) - 2.0 * model.link_radius_m,
        _flat(to_box_m(start[..., 1:, :], end[..., 1:, :], np.array(model.body_half_flu_m))) - model.link_radius_m,
        _to_propellers(model, start, end) - model.link_radius_m,
    ]
    what = [f"right {LINKS[i]} and left {LINKS[j]}" for i, j in _PAIRS]
    what += [f"{side} {link} and the body" for side in SIDES for link in LINKS[1:]]
    what += [f"{side} {link} and a propeller" for side in SIDES for link in LINKS]
    if floor_z_m is not None:
        columns.append(_flat(np.minimum(start, end)[..., 2]) - floor_z_m - model.link_radius_m)
        what += [f"{side} {link} and the floor" for side in SIDES for link in LINKS]
    return Distances(np.concatenate(columns, axis=-1), tuple(what))


def _between_arms(start: Array, end: Array) -> Array:
    i, j = (list(part) for part in zip(*_PAIRS, strict=True))
    return between_segments_m(start[..., 0, i, :], end[..., 0, i, :], start[..., 1, j, :], end[..., 1, j, :])


def _to_propellers(model: ArmModel, start: Array, end: Array) -> Array:
    propellers = model.propellers
    angle = propellers.first_rad + 2.0 * np.pi / propellers.count * np.arange(propellers.count)
    height = np.full(propellers.count, propellers.height_m)
    centres = np.stack((propellers.centre_m * np.cos(angle), propellers.centre_m * np.sin(angle), height), axis=-1)
    return _flat(to_discs_m(start, end, centres, propellers.radius_m).min(-1))


def _flat(by_link: Array) -> Array:
    """Reshape (..., 2 arms, links) to (..., pairs)."""
    return by_link.reshape((*by_link.shape[:-2], -1))
