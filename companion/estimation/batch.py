"""The estimator's filters for a batch of vehicles (...,), for simulations in virtual time.

The same filters as in flight: `kalman` and `attitude`, called as `estimator.step` does for an accepted frame. Verdicts
(outliers, repeats, stale stamps, restarts after a gap) and clock synchronisation exist for a single vehicle only: here
every fresh frame is accepted after any gap, and stamps are on the simulation's clock.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np

from companion.core.types import Array, Mask, Scalar, VehicleState
from companion.estimation import attitude as att
from companion.estimation import kalman
from companion.estimation.attitude import Attitude
from companion.estimation.estimator import first_covariances
from companion.estimation.kalman import Motion
from companion.estimation.state import EstimatorParams
from companion.geometry.array_math import column, stack, unstack, where_each
from companion.geometry.frames import matrix_from_quat


@dataclass(frozen=True)
class BatchEstimate:
    """Estimate of every vehicle at the capture of its last frame."""

    motion: Motion
    """In W, m; vectors (..., 3). Covariance of floats as long as all vehicles have seen the same frames."""
    attitude: Attitude
    """Components (...,); covariance as the motion's."""
    captured_s: Scalar
    """Time of that capture: a float when it is the same for all, else (...,)."""


def begin(position_w_m: Array, q_w_flu_wxyz: Array, time_s: Scalar, params: EstimatorParams) -> BatchEstimate:
    """Return the estimate of every vehicle from its first frame, assumed at rest.

    Position (..., 3) and unit quaternion (..., 4) as measured at `time_s`, a float or (...,); they broadcast.
    """
    lead = np.broadcast_shapes(position_w_m.shape[:-1], q_w_flu_wxyz.shape[:-1], np.shape(time_s))
    position, q = np.broadcast_to(position_w_m, (*lead, 3)), np.broadcast_to(q_w_flu_wxyz, (*lead, 4))
    of_motion, of_attitude = first_covariances(params)
    zero = np.zeros((*lead, 3))
    return BatchEstimate(Motion(position, zero, zero, of_motion), att.at_rest(matrix_from_quat(q), of_attitude), time_s)


def step(
    before: BatchEstimate,
    position_w_m: Array,
    q_w_flu_wxyz: Array,
    stamp_s: Scalar,
    fresh: Mask,
    params: EstimatorParams,
) -> BatchEstimate:
    """Take one frame of every vehicle that is `fresh`, shape (...,); the others stay as they are.

    Position (..., 3), unit quaternion (..., 4) of either sign, and stamp, a float or (...,), later than the vehicle's
    last; values that are not fresh may be NaN. Cheapest when all are fresh and `stamp_s` is a float.
    """
    if fresh.all():
        return _predict_and_correct(before, position_w_m, q_w_flu_wxyz, stamp_s, params)
    if not fresh.any():
        return before
    after = _predict_and_correct(before, position_w_m, q_w_flu_wxyz, stamp_s, params)
    return BatchEstimate(
        where_each(fresh[..., None], after.motion, before.motion),
        where_each(fresh, after.attitude, before.attitude),
        np.where(fresh, after.captured_s, before.captured_s),
    )


def vehicle_state(estimate: BatchEstimate) -> VehicleState:
    """Return all states at `estimate.captured_s`: vectors (..., 3), quaternion (..., 4), time as that."""
    return VehicleState(
        cast(float, estimate.captured_s),  # an array in a batch whose vehicles missed frames
        np.asarray(estimate.motion.position),
        np.asarray(estimate.motion.velocity),
        stack(*estimate.attitude.q),
        stack(*estimate.attitude.rate),
    )


def _predict_and_correct(
    before: BatchEstimate, position_w_m: Array, q_w_flu_wxyz: Array, stamp_s: Scalar, params: EstimatorParams
) -> BatchEstimate:
    """Predict all vehicles to the stamp and correct them, as `estimator.step` does for an accepted frame."""
    dt_s = stamp_s - before.captured_s
    motion = kalman.predict(before.motion, column(dt_s), params.jerk_density)
    motion = kalman.update(motion, position_w_m, params.noise_m * params.noise_m)
    attitude = att.predict(before.attitude, dt_s, params.angular_jerk_density)
    w, x, y, z = unstack(q_w_flu_wxyz)
    innovation = att.innovation_of_quat_rad(attitude, (w, x, y, z))
    return BatchEstimate(motion, att.update(attitude, innovation, params.noise_rad * params.noise_rad), stamp_s)
