"""Feed-forward of the arms for a whole flight, all cycles at once, as the arms' step computes it in flight."""

import numpy as np

from companion.arms.feedforward import (
    force_accel_b_mps2,
    leads_of,
    tilt_accel_b_mps2,
    trimmed_b_radps2,
    turning_b_radps2,
)
from companion.arms.trajectory import JointTrajectory
from companion.config.arms_config import ArmsConfig, Feedforward
from companion.config.companion_config import CompanionConfig
from companion.core.types import Array


def known_push_b_mps2(config: CompanionConfig, arms: ArmsConfig, motion: JointTrajectory, time_s: Array) -> Array:
    """Return the acceleration (n, 3), body frame, that the motion causes when a setpoint sent at `time_s` (n,) acts.

    `time_s` counts from the motion's start, in steps of the control period. The torque of the arms' initial pose is
    assumed to be trimmed out by the autopilot.
    """
    if arms.feedforward is Feedforward.OFF:
        return np.zeros((len(time_s), 3))
    model, airframe, leads = arms.model(), config.airframe(), leads_of(config.vehicle_model(), arms.servo_lag_s)
    across, upward = motion.at(time_s + leads.across_s), motion.at(time_s + leads.upward_s)
    force = force_accel_b_mps2(model, airframe, across, upward)
    if arms.feedforward is Feedforward.FORCE:
        return force
    turning = turning_b_radps2(model, airframe, motion.at(time_s + leads.turning_s))
    trimmed, before = np.empty_like(turning), turning[0]
    for row, now in enumerate(turning):
        before = trimmed_b_radps2(before, now, airframe, 1.0 / config.control.rate_hz)
        trimmed[row] = before
    return np.asarray(force + tilt_accel_b_mps2(turning - trimmed, airframe))
