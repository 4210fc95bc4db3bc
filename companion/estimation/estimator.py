"""Estimator of the vehicle's state at capture time from motion-capture frames, with a verdict on every frame."""

from dataclasses import replace
from math import acos, hypot, inf, isfinite
from operator import mul, sub
from typing import NamedTuple

import numpy as np

from companion.core.types import Array, MocapFrame, Scalar, VehicleState
from companion.estimation import attitude as att
from companion.estimation import kalman, others
from companion.estimation.attitude import Attitude
from companion.estimation.clock_sync import ClockSync, is_ahead, observe, to_local_s
from companion.estimation.kalman import Covariance, Motion
from companion.estimation.state import Counts, Estimate, EstimatorParams, EstimatorState, Verdict
from companion.geometry.array_math import Components, math_module

__all__ = ["Counts", "Estimate", "EstimatorParams", "EstimatorState", "Verdict", "age_s", "first_covariances", "step"]

Pose = tuple[float, ...]
"""Position, then the rotation row by row: twelve floats, cheap to compare and to check."""

_WRONG_STAMPS = frozenset({Verdict.STALE, Verdict.AHEAD})


class _Measurement(NamedTuple):
    """One frame, its pose, and the clock to convert its stamp with."""

    frame: MocapFrame
    pose: Pose
    clock: ClockSync


def step(
    state: EstimatorState, frame: MocapFrame, params: EstimatorParams, accel_input_w_mps2: Array | None = None
) -> EstimatorState:
    """Update the state with one frame, and decide its verdict; the others of the frame are filtered beside.

    `accel_input_w_mps2`, shape (3,): acceleration the rotors are known to have given since the last accepted frame
    (thrust per mass along the measured body z axis, less gravity); without it the filter estimates it.
    """
    after = _own_step(state, frame, params, accel_input_w_mps2)
    if not frame.others:
        return after
    if after.verdict in _WRONG_STAMPS:
        return replace(after, others=state.others, others_s=state.others_s)
    tracks = state.others
    if after.verdict is Verdict.STARTED and state.verdict in _WRONG_STAMPS:
        jump_s = (frame.stamp_s - state.stamp_s) - (frame.received_s - state.received_s)
        tracks = others.on_new_clock(tracks, jump_s)
    tracks = others.step(tracks, frame.others, frame.stamp_s, params)
    vehicle = after.vehicle
    if vehicle is not None and vehicle is not state.vehicle:
        vehicle = replace(vehicle, others=others.vehicles_of(tracks, frame.stamp_s))
    return replace(after, vehicle=vehicle, others=tracks, others_s=frame.stamp_s)


def _own_step(
    state: EstimatorState, frame: MocapFrame, params: EstimatorParams, accel_input_w_mps2: Array | None
) -> EstimatorState:
    ahead = is_ahead(state.clock, frame.stamp_s, frame.received_s, params.ahead_s)
    learnt = observe(ClockSync() if ahead else state.clock, frame.stamp_s, frame.received_s, params.clock_window_s)
    back = frame.stamp_s < state.clock.last_stamp_s
    clock = state.clock if ahead or back else learnt  # one broken stamp must not make all that follow look wrong
    pose = (*frame.position_w_m.tolist(), *frame.rotation_w_b.ravel().tolist())
    measured = _Measurement(frame, pose, learnt)
    rejection = _rejection(pose, state, params)
    if rejection is not None:
        return _rejected(state, rejection, clock, pose if rejection is Verdict.REPEATED else state.pose)
    dt_s, silent_s = frame.stamp_s - state.stamp_s, frame.received_s - state.received_s
    if state.motion is None or state.attitude is None or min(abs(dt_s), silent_s) > params.max_gap_s:
        return _restarted(state, measured, params)
    if ahead or dt_s <= 0.0:
        return _wrong_stamp(state, Verdict.AHEAD if ahead else Verdict.STALE, measured, params)
    if back:
        measured = _Measurement(frame, pose, clock)
    known = None if accel_input_w_mps2 is None else tuple(accel_input_w_mps2.tolist())
    motion = kalman.predict(state.motion, dt_s, params.jerk_density, known)
    attitude = att.predict(state.attitude, dt_s, params.angular_jerk_density)
    innovation = att.innovation_rad(attitude, pose[3:])
    off = _distance(pose[:3], motion.position), hypot(*innovation)
    if not _possible(*off, motion, attitude, dt_s, params) or _continues_outlier(state, pose, off, params):
        return _outlier(state, measured, params)
    motion = kalman.update(motion, pose[:3], params.noise_m * params.noise_m)
    attitude = att.update(attitude, innovation, params.noise_rad * params.noise_rad)
    return _accepted(state, Verdict.ACCEPTED, measured, params, motion, attitude)


def first_covariances(params: EstimatorParams) -> tuple[Covariance, Covariance]:
    """Return the covariances of motion and attitude after the first frame.

    The vehicle is assumed at rest, to within 1 m/s and 5 m/s^2, 1 rad/s and 10 rad/s^2.
    """
    return kalman.first_covariance(params.noise_m), Covariance(
        params.noise_rad * params.noise_rad, 0.0, 0.0, 1.0, 0.0, 100.0
    )


def age_s(state: Estimate, now_s: float) -> float:
    """Return the time since the capture of the last accepted frame; infinite before the first one."""
    vehicle = state.vehicle
    return now_s - vehicle.time_s if vehicle is not None else inf


def _rejection(pose: Pose, state: EstimatorState, params: EstimatorParams) -> Verdict | None:
    """Return the verdict that rejects a pose without comparing it with a prediction; None for none."""
    if not isfinite(sum(pose)):
        return Verdict.UNTRACKED
    if not att.is_rotation(pose[3:]) or hypot(*pose[:3]) > params.room_m:
        return Verdict.INVALID
    if params.drop_repeats and pose == state.pose:
        return Verdict.REPEATED
    return None


def _possible(
    off_m: float, turn_rad: float, motion: Motion, attitude: Attitude, dt_s: float, params: EstimatorParams
) -> bool:
    """Return True if the innovation is within noise, uncertainty (3 sigma) and the airframe's abilities in `dt_s`."""
    gate_m, gate_rad = gates(motion, attitude, dt_s, params)
    return bool(off_m <= gate_m and turn_rad <= gate_rad)


def gates(motion: Motion, attitude: Attitude, dt_s: Scalar, params: EstimatorParams) -> tuple[Scalar, Scalar]:
    """Return the largest innovations (m, rad) that are possible `dt_s` after the last accepted frame."""
    half, pp, turn_pp = 0.5 * dt_s * dt_s, motion.covariance.pp, attitude.covariance.pp
    m = math_module(pp)
    return (
        params.gate_m + params.max_accel_mps2 * half + 3.0 * m.sqrt(pp),
        params.gate_rad + params.max_turn_radps2 * half + 3.0 * m.sqrt(turn_pp),
    )


def _continues_outlier(state: EstimatorState, pose: Pose, off: tuple[float, float], params: EstimatorParams) -> bool:
    """Return True if a pose `off` (m, rad) from the prediction continues the last outlier rather than the estimate.

    The gate widens with the time since the last accepted frame. A step that is impossible from one frame to the next
    must not be accepted only because time has passed, while the frames still show the step.
    """
    if not _agrees(state, pose, params):
        return False
    apart_m, apart_rad = _difference(state.pose, pose)
    off_m, off_rad = off
    return max(apart_m / params.gate_m, apart_rad / params.gate_rad) < max(
        off_m / params.gate_m, off_rad / params.gate_rad
    )


def _agrees(state: EstimatorState, pose: Pose, params: EstimatorParams) -> bool:
    """Return True if the frame before was an outlier, and near this pose."""
    if state.agreeing == 0:
        return False
    apart_m, apart_rad = _difference(state.pose, pose)
    return apart_m <= params.agree_m and apart_rad <= params.agree_rad


def _difference(a: Pose, b: Pose) -> tuple[float, float]:
    """Return distance (m) and angle (rad) between two poses."""
    cosine = 0.5 * (sum(map(mul, a[3:], b[3:])) - 1.0)  # the trace of A' B
    return _distance(a[:3], b[:3]), acos(min(max(cosine, -1.0), 1.0))


def _distance(a: Components, b: Components) -> float:
    return hypot(*map(sub, a, b))


def _restarted(state: EstimatorState, measured: _Measurement, params: EstimatorParams) -> EstimatorState:
    """Return the state that starts from this frame alone."""
    of_motion, of_attitude = first_covariances(params)
    motion = Motion(measured.pose[:3], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), of_motion)
    attitude = att.at_rest(measured.frame.rotation_w_b, of_attitude)
    return _accepted(state, Verdict.STARTED, measured, params, motion, attitude)


def _wrong_stamp(
    state: EstimatorState, verdict: Verdict, measured: _Measurement, params: EstimatorParams
) -> EstimatorState:
    """Reject a stamp that goes back or is ahead; restart with its clock after several in a row."""
    if _run(state, verdict) >= params.stamps_to_restart:
        return _restarted(state, measured, params)
    return _rejected(state, verdict, state.clock, state.pose)


def _outlier(state: EstimatorState, measured: _Measurement, params: EstimatorParams) -> EstimatorState:
    agreeing = state.agreeing + 1 if _agrees(state, measured.pose, params) else 1
    if agreeing >= params.outliers_to_restart:
        return _restarted(state, measured, params)
    return replace(_rejected(state, Verdict.OUTLIER, measured.clock, measured.pose), agreeing=agreeing)


def _rejected(state: EstimatorState, verdict: Verdict, clock: ClockSync, pose: Pose) -> EstimatorState:
    """Keep the estimate unchanged; its age grows, which its users check."""
    return replace(
        state,
        verdict=verdict,
        run=_run(state, verdict),
        counts=state.counts.plus(verdict),
        clock=clock,
        pose=pose,
    )


def _accepted(
    state: EstimatorState,
    verdict: Verdict,
    measured: _Measurement,
    params: EstimatorParams,
    motion: Motion,
    attitude: Attitude,
) -> EstimatorState:
    frame, pose, clock = measured
    vehicle = VehicleState(
        to_local_s(clock, frame.stamp_s, params.delay_s),
        np.array(motion.position),
        np.array(motion.velocity),
        np.array(attitude.q),
        np.array(attitude.rate),
    )
    return EstimatorState(
        vehicle=vehicle,
        verdict=verdict,
        run=_run(state, verdict),
        counts=state.counts.plus(verdict),
        clock=clock,
        motion=motion,
        attitude=attitude,
        stamp_s=frame.stamp_s,
        received_s=frame.received_s,
        pose=pose,
    )


def _run(state: EstimatorState, verdict: Verdict) -> int:
    """Return the number of frames in a row with this verdict."""
    return state.run + 1 if verdict == state.verdict else 1
