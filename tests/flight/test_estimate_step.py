"""The estimator's part of a tick: what is new is used once, and what it was made from is handed on."""

import math
from dataclasses import replace

import numpy as np

from companion.core.types import NOT_HEARD, AutopilotStatus, GroundPose, MocapFrame
from companion.estimation.estimator import EstimatorParams, Verdict
from companion.estimation.from_autopilot import FromAutopilotParams
from companion.flight.estimate_step import EstimateFromAutopilot, EstimateFromFrames


class Source:
    """MocapSource and GroundPoses: what a test puts there."""

    def __init__(self) -> None:
        self.frame: MocapFrame | None = None
        self.pose: GroundPose | None = None

    def latest(self) -> MocapFrame | None:
        return self.frame

    def latest_pose(self) -> GroundPose | None:
        return self.pose

    async def wait_frame(self, timeout_s: float) -> bool:
        raise NotImplementedError

    def why_silent(self) -> str:
        return ""


def frame(number: int, stamp_s: float) -> MocapFrame:
    place = np.array([0.0, 0.0, 1.0 + 1e-4 * stamp_s])
    return MocapFrame(
        frame=number, stamp_s=stamp_s, received_s=100.0 + stamp_s, position_w_m=place, rotation_w_b=np.eye(3),
        residual_m=0.001,
    )  # fmt: skip


def moving(at_s: float) -> AutopilotStatus:
    return replace(
        NOT_HEARD,
        attitude_s=at_s,
        velocity_s=at_s,
        velocity_w_mps=np.array([0.1, 0.0, 0.0]),
        rate_flu_radps=np.zeros(3),
    )


def pose(time_s: float) -> GroundPose:
    return GroundPose(time_s=time_s, position_w_m=np.array([0.1 * time_s, 0.0, 1.0]), yaw_rad=0.2)


def test_a_frame_is_used_once_and_a_new_one_is_known_by_its_stamp_too() -> None:
    source = Source()
    step = EstimateFromFrames(source, EstimatorParams())
    assert step.waiting_s() is None
    assert not step.read(NOT_HEARD).is_new
    for stamp_s in (1.0, 1.01):  # both are number 1
        source.frame = frame(1, stamp_s)
        assert step.waiting_s() == 100.0 + stamp_s
        arrival = step.read(NOT_HEARD)
        assert (arrival.frame, arrival.frame_received_s, arrival.status) == (source.frame, 100.0 + stamp_s, None)
        assert step.waiting_s() is None
        again = step.read(NOT_HEARD)
        assert not again.is_new
        assert math.isnan(again.frame_received_s)
    assert step.for_vision(200.0) is step.state


def test_without_frames_the_status_that_was_used_is_handed_on_for_the_record() -> None:
    source = Source()
    step = EstimateFromAutopilot(source, FromAutopilotParams())
    unheard = step.read(NOT_HEARD)
    assert (unheard.is_new, unheard.status, step.state.vehicle) == (False, NOT_HEARD, None)
    assert step.for_vision(10.0).vehicle is None
    source.pose, status = pose(10.0), moving(10.0)
    arrival = step.read(status)
    assert (arrival.pose, arrival.status, arrival.frame) == (source.pose, status, None)
    later = moving(10.02)
    again = step.read(later)
    assert (again.is_new, again.status) == (False, later), "the pose counts once, the motion goes on"
    assert step.waiting_s() is None, "only the deadline starts a cycle"


def test_without_frames_the_autopilot_gets_the_pose_of_motion_captures_usual_delay_ago() -> None:
    source = Source()
    params = FromAutopilotParams(vision_delay_s=0.03)
    step = EstimateFromAutopilot(source, params)
    source.pose = pose(10.0)
    step.read(moving(10.0))
    seen = step.for_vision(10.05)
    assert seen.verdict is Verdict.STARTED
    assert seen.vehicle is not None
    assert seen.vehicle.time_s == 10.05 - params.vision_delay_s
    assert np.allclose(seen.vehicle.position_w_m, pose(10.02).position_w_m)
