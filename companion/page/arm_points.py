"""Points of the arms to draw, from joint angles and the [arms] table that a vehicle publishes."""

import json
from typing import Any

import numpy as np
from pydantic import ValidationError

from companion.arms.kinematics import points_flu_m
from companion.arms.model import SIDES, ArmModel
from companion.config.arms_config import ArmsConfig
from companion.protocol.about import About
from companion.protocol.telemetry import State

_DIGITS = 4


def model_of(about: About | None) -> ArmModel | None:
    """Return the model of a vehicle's arms; None without arms, and for a table of another version."""
    if about is None or about.arms is None:
        return None
    try:
        return ArmsConfig.model_validate_json(json.dumps(about.arms)).model()
    except ValidationError:
        return None


def arms_b_m(model: ArmModel | None, state: State) -> dict[str, Any] | None:
    """Return shoulder, elbow, wrist and tip of each arm in body FLU, m; None while a joint is not known."""
    joints = state.joints_rad
    if model is None or joints is None or None in joints or len(joints) != len(SIDES) * 4:
        return None
    points = np.round(points_flu_m(model, np.array(joints, dtype=float)), _DIGITS)
    return {str(side): arm.tolist() for side, arm in zip(SIDES, points, strict=True)}
