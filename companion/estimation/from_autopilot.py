"""Estimate of the vehicle's motion without motion capture's frames: the autopilot's own, and the ground's poses.

Attitude and body rate are the autopilot's. The position is the ground's newest pose, carried on by the autopilot's
velocity. That velocity is off by up to 0.75 m/s (recorded from PX4 v1.17, and slowly), but the ground's poses are exact
to a millimetre: the distance between where one was expected and where it lies shows the velocity's error, which passes
a first-order low pass and is subtracted. Pure, one vehicle.
"""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from companion.core.types import Array, GroundPose, VehicleState
from companion.estimation.state import EstimatorState, Verdict
from companion.geometry.frames import quat_from_yaw, quat_multiply, turned, yaw_of

_LONGEST_S = 0.5
"""Longest time over which a heading is carried on by the turn rate."""


class OwnMotion(Protocol):
    """The autopilot's own motion; see AutopilotStatus."""

    @property
    def q_w_flu_wxyz(self) -> Array:
        """Attitude, (4,)."""

    @property
    def rate_flu_radps(self) -> Array:
        """Body rate, (3,)."""

    @property
    def attitude_s(self) -> float:
        """Arrival of both."""

    @property
    def velocity_w_mps(self) -> Array:
        """Velocity, (3,)."""

    @property
    def velocity_s(self) -> float:
        """Arrival of the velocity."""


@dataclass(frozen=True, kw_only=True)
class FromAutopilotParams:
    """Tuning; the delays are those of [px4] and [mocap]."""

    attitude_delay_s: float = 0.002
    """From the instant of the autopilot's attitude to its arrival."""
    velocity_kept_s: float = 0.15
    """Age up to which a velocity is used like a new one: it comes at 30 Hz. An older one makes the estimate old."""
    error_s: float = 0.4
    """Time constant of the velocity's error; those of PX4 v1.17 last for seconds."""
    restart_m: float = 0.3
    """Distance from the expected position that no error of the velocity explains: the estimate begins anew there."""
    vision_delay_s: float = 0.010
    """Age that a pose has for the autopilot's estimator when it arrives there (PX4's EKF2_EV_DELAY)."""


def step(
    state: EstimatorState, status: OwnMotion, pose: GroundPose | None, params: FromAutopilotParams
) -> EstimatorState:
    """Advance to the autopilot's newest attitude, and take a pose that is newer than the one before.

    Unchanged before the first pose, and before the autopilot's first attitude and velocity. A pose with NaN is ignored.
    """
    new = pose is not None and pose.time_s > state.stamp_s and bool(np.isfinite(pose.position_w_m).all())
    if not _known(status) or (state.vehicle is None and not new):
        return state
    at_s = min(status.attitude_s - params.attitude_delay_s, status.velocity_s + params.velocity_kept_s)
    velocity_w_mps = status.velocity_w_mps - np.array(state.velocity_off_w_mps)
    position_w_m = _carried(state.vehicle, at_s, velocity_w_mps)
    moved = VehicleState(at_s, position_w_m, velocity_w_mps, status.q_w_flu_wxyz, status.rate_flu_radps)
    if pose is None or not new:
        return replace(state, vehicle=moved)
    missed_w_m = pose.position_w_m - _carried(moved, pose.time_s, velocity_w_mps)
    if state.vehicle is None or not math.hypot(*missed_w_m.tolist()) <= params.restart_m:
        return _restarted(state, moved, status, pose)
    return _corrected(state, moved, pose, missed_w_m, params)


def vision_of(state: EstimatorState, pose: GroundPose, at_s: float) -> VehicleState | None:
    """Return the pose for the autopilot's estimator at `at_s`: position and heading by the ground, tilt as it is."""
    vehicle = state.vehicle
    if vehicle is None:
        return None
    turn_radps = float(turned(vehicle.q_w_flu_wxyz, vehicle.rate_flu_radps)[2])
    yaw_rad = pose.yaw_rad + turn_radps * min(max(at_s - pose.time_s, -_LONGEST_S), _LONGEST_S)
    q = quat_multiply(quat_from_yaw(yaw_rad - float(yaw_of(vehicle.q_w_flu_wxyz))), vehicle.q_w_flu_wxyz)
    return replace(vehicle, time_s=at_s, position_w_m=_carried(vehicle, at_s, vehicle.velocity_w_mps), q_w_flu_wxyz=q)


def _known(status: OwnMotion) -> bool:
    """Return True if attitude, rate and velocity have come."""
    own = (*status.q_w_flu_wxyz.tolist(), *status.rate_flu_radps.tolist(), *status.velocity_w_mps.tolist())
    return math.isfinite(sum(own)) and math.isfinite(status.attitude_s + status.velocity_s)


def _carried(vehicle: VehicleState | None, to_s: float, velocity_w_mps: Array) -> Array:
    """Return the position (3,) at another time, reached with a constant velocity; zero without a vehicle."""
    if vehicle is None:
        return np.zeros(3)
    return np.asarray(vehicle.position_w_m + velocity_w_mps * (to_s - vehicle.time_s))


def _restarted(state: EstimatorState, moved: VehicleState, status: OwnMotion, pose: GroundPose) -> EstimatorState:
    """Return the state that begins with this pose and the autopilot's velocity as it is."""
    velocity_w_mps = status.velocity_w_mps
    position_w_m = pose.position_w_m + velocity_w_mps * (moved.time_s - pose.time_s)
    vehicle = replace(moved, position_w_m=position_w_m, velocity_w_mps=velocity_w_mps)
    fresh = EstimatorState(vehicle=vehicle, counts=state.counts, verdict=state.verdict, run=state.run)
    return _taken(fresh, Verdict.STARTED, pose)


def _corrected(
    state: EstimatorState, moved: VehicleState, pose: GroundPose, missed_w_m: Array, params: FromAutopilotParams
) -> EstimatorState:
    """Return the state with a pose that was `missed_w_m` off: its position, and more of the velocity's error."""
    passed_s = pose.time_s - state.stamp_s
    found_w_mps = missed_w_m * ((1.0 - math.exp(-passed_s / params.error_s)) / passed_s)
    x, y, z = (np.array(state.velocity_off_w_mps) - found_w_mps).tolist()
    position_w_m, velocity_w_mps = moved.position_w_m + missed_w_m, moved.velocity_w_mps + found_w_mps
    vehicle = replace(moved, position_w_m=position_w_m, velocity_w_mps=velocity_w_mps)
    return _taken(replace(state, vehicle=vehicle, velocity_off_w_mps=(x, y, z)), Verdict.ACCEPTED, pose)


def _taken(state: EstimatorState, verdict: Verdict, pose: GroundPose) -> EstimatorState:
    """Return the state with a pose counted."""
    run = state.run + 1 if verdict is state.verdict else 1
    return replace(state, verdict=verdict, run=run, counts=state.counts.plus(verdict), stamp_s=pose.time_s)
