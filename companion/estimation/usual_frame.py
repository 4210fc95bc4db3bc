"""Estimator's step for the usual frame, one that is accepted whatever the rounding of its distance. Pure.

Written without branches, so that it can be compiled: the same numbers as `estimator.step`. All that is rare in a frame
is left to that.
"""

from companion.core.types import Flag, Scalar
from companion.core.values import value
from companion.estimation import attitude as att
from companion.estimation import estimator, kalman
from companion.estimation.attitude import Attitude
from companion.estimation.clock_sync import ClockSync, is_ahead, observe_later, to_local_s
from companion.estimation.estimator import EstimatorParams, EstimatorState, Pose
from companion.estimation.kalman import Covariance, Motion
from companion.geometry.array_math import math_module

_SURELY = 1.0 - 1e-9
"""Share of a gate within which a frame is accepted whatever the rounding of its distance."""


@value
class Filters:
    """The estimator's filters."""

    motion: Motion
    attitude: Attitude


@value
class Followed:
    """Estimator's memory while frames are accepted."""

    filters: Filters
    clock: ClockSync
    stamp_s: float
    received_s: float
    pose: Pose


@value
class Measured:
    """Numbers of one frame."""

    pose: Pose
    stamp_s: float
    received_s: float


_NONE, _ZERO = Covariance(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
NOT_FOLLOWED = Followed(
    Filters(Motion(_ZERO, _ZERO, _ZERO, _NONE), Attitude((1.0, 0.0, 0.0, 0.0), _ZERO, _ZERO, _NONE)),
    ClockSync(),
    0.0,
    0.0,
    (0.0,) * 12,
)
"""The shapes of these numbers."""


def followed(state: EstimatorState) -> Followed | None:
    """Return an estimate's memory; None where the next frame needs more than that."""
    if state.motion is None or state.attitude is None or state.agreeing or not state.pose:
        return None
    filters = Filters(state.motion, state.attitude)
    return Followed(filters, state.clock, state.stamp_s, state.received_s, state.pose)


def corrected(before: Filters, pose: Pose, dt_s: float, params: EstimatorParams) -> tuple[Filters, Flag]:
    """Return the filters after a pose `dt_s` later, and whether it lies surely within the gates."""
    motion = kalman.predict(before.motion, dt_s, params.jerk_density)
    attitude = att.predict(before.attitude, dt_s, params.angular_jerk_density)
    x, y, z = innovation = att.innovation_rad(attitude, pose[3:])
    a, b, c = (measured - position for measured, position in zip(pose[:3], motion.position, strict=True))
    gate_m, gate_rad = estimator.gates(motion, attitude, dt_s, params)
    near = a * a + b * b + c * c <= _SURELY * gate_m * gate_m
    accepted = near & (x * x + y * y + z * z <= _SURELY * gate_rad * gate_rad)
    motion = kalman.update(motion, pose[:3], params.noise_m * params.noise_m)
    return Filters(motion, att.update(attitude, innovation, params.noise_rad * params.noise_rad)), accepted


def take(before: Followed, frame: Measured, params: EstimatorParams) -> tuple[Followed, Flag]:
    """Return the memory after a frame, and whether the frame is a usual one: if not, the memory means nothing."""
    dt_s = frame.stamp_s - before.stamp_s
    filters, near = corrected(before.filters, frame.pose, dt_s, params)
    clock = observe_later(before.clock, frame.stamp_s, frame.received_s, params.clock_window_s)
    in_order = (dt_s > 0.0) & (dt_s <= params.max_gap_s) & (frame.stamp_s >= before.clock.last_stamp_s)
    on_time = is_ahead(before.clock, frame.stamp_s, frame.received_s, params.ahead_s) ^ True
    usual = in_order & on_time & _is_valid(frame.pose, params) & _is_another(frame.pose, before.pose, params) & near
    return Followed(filters, clock, frame.stamp_s, frame.received_s, frame.pose), usual


def captured_s(after: Followed, params: EstimatorParams) -> float:
    """Return the capture of the last frame on the service's clock."""
    return to_local_s(after.clock, after.stamp_s, params.delay_s)


def _is_valid(pose: Pose, params: EstimatorParams) -> Flag:
    x, y, z = pose[:3]
    total: Scalar = sum(pose[1:], pose[0])
    finite = math_module(total).isfinite(total)
    return finite & att.is_rotation(pose[3:]) & (x * x + y * y + z * z <= _SURELY * params.room_m * params.room_m)


def _is_another(pose: Pose, before: Pose, params: EstimatorParams) -> Flag:
    differs: Flag = params.drop_repeats ^ True
    for now, then in zip(pose, before, strict=True):
        differs = differs | (now != then)
    return differs
