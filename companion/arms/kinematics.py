"""Positions of the arms' links: forward kinematics, in body FLU.

The paper names the joints and gives L_1 to L_3 (section 5), but no axes; these are a human arm's, see
docs/arms-geometry.md.
With shoulder pitch a, elbow pitch b, elbow roll r, s = a + b and the outward direction o (-1 right, +1 left), the links
point along

    upper arm (L_1)   u = (sin a, 0, -cos a)
    elbow (L_2)       e = (sin s, 0, -cos s)
    forearm (L_3)     f = (cos r sin s, o sin r, -cos r cos s)
"""

import numpy as np

from companion.arms.model import CHAIN, JOINTS_PER_ARM, SIDES, ArmModel
from companion.core.types import Array

OUTWARD = np.array([-1.0, 1.0])
"""Sign of body y away from the body, right then left."""
POINTS = ("shoulder", "elbow", "wrist", "tip")
"""Ends of the links: shoulder axis, elbow pitch axis, elbow roll axis, end of the claw."""


def by_arm(joints: Array) -> Array:
    """Return joint vectors (..., 8) as pitch, pitch and roll of each arm, (..., 2, 3), without the claws."""
    shape = (*joints.shape[:-1], len(SIDES), JOINTS_PER_ARM)
    return np.reshape(joints, shape)[..., :CHAIN]


def link_directions(joints_rad: Array) -> Array:
    """Return unit vectors along upper arm, elbow link and forearm, (..., 2 arms, 3 links, 3), body FLU."""
    a, b, r = np.moveaxis(by_arm(joints_rad), -1, 0)
    s = a + b
    out = np.zeros((*a.shape, 3, 3))
    out[..., 0, 0], out[..., 0, 2] = np.sin(a), -np.cos(a)
    out[..., 1, 0], out[..., 1, 2] = np.sin(s), -np.cos(s)
    out[..., 2, :] = np.cos(r)[..., None] * out[..., 1, :]
    out[..., 2, 1] = OUTWARD * np.sin(r)
    return out


def points_flu_m(model: ArmModel, joints_rad: Array) -> Array:
    """Return shoulder, elbow, wrist and tip, (..., 2 arms, 4 points, 3), body FLU, m; joints (..., 8)."""
    lengths = np.array([link.length_m for link in model.links])
    directions = link_directions(joints_rad)
    out = np.empty((*directions.shape[:-2], len(POINTS), 3))
    out[..., 0, :] = model.shoulders_flu_m()
    for link in range(CHAIN):
        out[..., link + 1, :] = out[..., link, :] + lengths[link] * directions[..., link, :]
    return out


def tips_flu_m(model: ArmModel, joints_rad: Array) -> Array:
    """Return the positions of the claws, (..., 2 arms, 3), body FLU, m."""
    return points_flu_m(model, joints_rad)[..., -1, :]
