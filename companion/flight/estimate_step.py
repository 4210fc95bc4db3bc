"""The estimator's part of a tick: from motion capture's frames, or on a vehicle that they do not reach without them."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from companion.core.interfaces import GroundPoses, MocapSource
from companion.core.types import AutopilotStatus, GroundPose, MocapFrame
from companion.estimation import from_autopilot
from companion.estimation.estimator import Estimate, EstimatorParams, EstimatorState
from companion.estimation.frame_estimator import FrameEstimator
from companion.estimation.from_autopilot import FromAutopilotParams
from companion.law_link.vehicle_end import VehicleEnd


@dataclass(frozen=True)
class Arrival:
    """New measurement that a cycle is the first to use; nothing where there is none."""

    frame: MocapFrame | None = None
    pose: GroundPose | None = None
    status: AutopilotStatus | None = None
    """The autopilot's status that the estimate was made from; None where it was made from frames."""

    @property
    def frame_received_s(self) -> float:
        """Arrival of the frame, s; NaN without one."""
        return math.nan if self.frame is None else self.frame.received_s

    @property
    def is_new(self) -> bool:
        """True if there is something new."""
        return self.frame is not None or self.pose is not None


_NOTHING = Arrival()


class EstimateStep(Protocol):
    """Keeper of the estimate of the vehicle's motion."""

    @property
    def state(self) -> EstimatorState:
        """Return all that is known."""

    @property
    def latest(self) -> Estimate:
        """Return what the setpoint depends on, as of now; valid until the next `read`."""

    def waiting_s(self) -> float | None:
        """Return the arrival (s) of a frame that `read` has not used yet; None without one."""

    def read(self, status: AutopilotStatus) -> Arrival:
        """Take what is new, once a cycle."""

    def for_vision(self, now_s: float) -> EstimatorState:
        """Return the estimate whose pose is forwarded to the autopilot's estimator."""


class EstimateFromFrames:
    """Estimate from motion capture's frames."""

    def __init__(self, mocap: MocapSource, params: EstimatorParams) -> None:
        self._mocap, self._estimator = mocap, FrameEstimator(params)
        self._frame: MocapFrame | None = None

    @property
    def state(self) -> EstimatorState:
        """Return all that is known."""
        return self._estimator.state

    @property
    def latest(self) -> Estimate:
        """Return what the setpoint depends on; the rest of the state is put together later."""
        return self._estimator

    def waiting_s(self) -> float | None:
        """Return the arrival (s) of a frame that was not used yet; None without one."""
        frame = self._new_frame()
        return None if frame is None else frame.received_s

    def read(self, status: AutopilotStatus) -> Arrival:  # noqa: ARG002 - the interface's
        """Feed the newest frame to the estimator, if there is a new one."""
        frame = self._new_frame()
        if frame is None:
            return _NOTHING
        self._frame = frame
        self._estimator.step(frame)
        return Arrival(frame=frame)

    def for_vision(self, now_s: float) -> EstimatorState:  # noqa: ARG002 - the interface's
        """Return the estimate at capture time."""
        return self.state

    def _new_frame(self) -> MocapFrame | None:
        """Return the newest frame if it is new."""
        frame = self._mocap.latest()
        return None if frame is None or frame.is_same(self._frame) else frame


class LinkPoses:
    """GroundPoses from the link to a law on the ground."""

    def __init__(self, end: VehicleEnd) -> None:
        self._end = end

    def latest_pose(self) -> GroundPose | None:
        """Return the newest pose that a message of the ground law carried; None before the first one."""
        newest = self._end.pose
        if newest is None:
            return None
        pose, sent_s = newest
        return GroundPose(time_s=sent_s, position_w_m=np.array(pose.position_w_m), yaw_rad=pose.yaw_rad)


class EstimateFromAutopilot:
    """Estimate of a vehicle that no frames reach: the autopilot's own motion, and the ground's poses."""

    def __init__(self, ground: GroundPoses, params: FromAutopilotParams) -> None:
        self._ground, self._params = ground, params
        self._pose: GroundPose | None = None
        self.state = EstimatorState()

    @property
    def latest(self) -> Estimate:
        """Return the state."""
        return self.state

    def waiting_s(self) -> float | None:
        """Return None: only the deadline starts a cycle."""
        return None

    def read(self, status: AutopilotStatus) -> Arrival:
        """Advance to the autopilot's newest motion, and take the ground's newest pose."""
        pose, before = self._ground.latest_pose(), self.state
        self.state = from_autopilot.step(before, status, pose, self._params)
        if pose is None or self.state.stamp_s == before.stamp_s:
            return Arrival(status=status)
        self._pose = pose
        return Arrival(pose=pose, status=status)

    def for_vision(self, now_s: float) -> EstimatorState:
        """Return the estimate with the pose of motion capture's usual delay ago, as the autopilot expects it."""
        if self._pose is None:
            return self.state
        seen = from_autopilot.vision_of(self.state, self._pose, now_s - self._params.vision_delay_s)
        return replace(self.state, vehicle=seen)
