"""The estimate of a vehicle without frames, against the truth of flights whose autopilot's velocity is off."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from companion.core.types import Array, AutopilotStatus, FlightMode, GroundPose
from companion.estimation.from_autopilot import FromAutopilotParams, step, vision_of
from companion.estimation.state import EstimatorState, Verdict
from companion.geometry.frames import quat_from_rotation_vector, quat_from_yaw, quat_multiply, up_axis, yaw_of

PARAMS = FromAutopilotParams()
STATUS = AutopilotStatus(
    connected=True,
    heartbeat_s=0.0,
    armed=True,
    mode=FlightMode.OFFBOARD,
    in_air=True,
    battery_fraction=0.9,
    battery_v=16.0,
    q_w_flu_wxyz=quat_from_yaw(0.3),
    last_text="",
)
POSE_EVERY_S, ATTITUDE_EVERY_S, VELOCITY_EVERY_S = 0.03, 0.02, 0.033
TURN_RADPS = 0.4


def place(time_s: float) -> Array:
    """Return the position of a vehicle on an ellipse, 1 m/s at most."""
    return np.array([1.0 * math.sin(time_s), 0.6 * math.cos(time_s), 1.2 + 0.2 * math.sin(0.5 * time_s)])


def velocity(time_s: float) -> Array:
    """Return its velocity."""
    return np.array([math.cos(time_s), -0.6 * math.sin(time_s), 0.1 * math.cos(0.5 * time_s)])


def error(time_s: float) -> Array:
    """Return the error of the autopilot's velocity: up to 0.4 m/s, with periods of several seconds."""
    return np.array([0.4 * math.sin(0.9 * time_s), 0.3 * math.cos(0.7 * time_s), 0.14 * math.sin(1.1 * time_s)])


def pose_at(time_s: float) -> GroundPose:
    """Return the ground's pose, as exact as its message: to a millimetre and 1e-4 rad."""
    return GroundPose(
        time_s=time_s,
        position_w_m=place(time_s).round(3),
        yaw_rad=round(math.remainder(TURN_RADPS * time_s, math.tau), 4),
    )


def status_at(time_s: float, heard_s: float) -> AutopilotStatus:
    """Return what the autopilot says at a time, with the velocity that it had said at `heard_s`."""
    q = quat_multiply(quat_from_yaw(TURN_RADPS * time_s), quat_from_rotation_vector(np.array([0.05, -0.03, 0.0])))
    return replace(
        STATUS,
        q_w_flu_wxyz=q,
        rate_flu_radps=np.array([0.0, 0.0, TURN_RADPS]),
        attitude_s=time_s + PARAMS.attitude_delay_s,
        velocity_w_mps=velocity(heard_s) + error(heard_s),
        velocity_s=heard_s,
    )


def estimates(seconds_s: float, radio_s: float = 0.02, silent_from_s: float = math.inf) -> list[EstimatorState]:
    """Return the estimate of each cycle of 10 ms; poses come `radio_s` late, and none after `silent_from_s`."""
    state, all_of_them = EstimatorState(), []
    for cycle in range(round(seconds_s / 0.01)):
        now_s = 10.0 + 0.01 * cycle
        floor = partial(_last, now_s=now_s)
        status = status_at(floor(ATTITUDE_EVERY_S), floor(VELOCITY_EVERY_S))
        sent_s = _last(POSE_EVERY_S, min(now_s, silent_from_s) - radio_s)
        state = step(state, status, pose_at(sent_s), PARAMS)
        all_of_them.append(state)
    return all_of_them


def _last(period_s: float, now_s: float) -> float:
    """Return the last multiple of a period."""
    return math.floor(now_s / period_s + 1e-9) * period_s


@pytest.mark.parametrize("radio_s", [0.0, 0.02, 0.1])
def test_position_and_velocity_are_near_the_truth_though_the_autopilots_velocity_is_off(radio_s: float) -> None:
    states = estimates(12.0, radio_s)[200:]
    vehicles = [state.vehicle for state in states if state.vehicle is not None]
    off_m = [math.dist(one.position_w_m, place(one.time_s)) for one in vehicles]
    wrong_mps = [float(np.linalg.norm(one.velocity_w_mps - velocity(one.time_s))) for one in vehicles]
    theirs_mps = [float(np.linalg.norm(error(one.time_s))) for one in vehicles]
    assert len(vehicles) == len(states)
    assert max(off_m) < 0.02 + 0.2 * radio_s
    assert np.mean(wrong_mps) < 0.5 * float(np.mean(theirs_mps))


def test_attitude_and_rate_are_the_autopilots_at_its_instant() -> None:
    state = estimates(0.5)[-1]
    assert state.vehicle is not None
    assert state.vehicle.q_w_flu_wxyz.tolist() == status_at(state.vehicle.time_s, 0.0).q_w_flu_wxyz.tolist()
    assert state.vehicle.time_s == pytest.approx(10.48), "50 Hz: of the cycle before"


def test_a_silent_ground_leaves_the_position_to_drift_with_what_is_left_of_the_error() -> None:
    states = estimates(9.0, silent_from_s=17.0)
    last = states[-1].vehicle
    assert last is not None
    assert last.time_s > 18.9, "it goes on"
    assert math.dist(last.position_w_m, place(last.time_s)) < 1.0, "the autopilot's velocity alone is that bad"
    assert states[-1].stamp_s == states[-150].stamp_s < 17.0


def test_nothing_is_known_before_pose_attitude_and_velocity() -> None:
    nothing, pose, status = EstimatorState(), pose_at(10.0), status_at(10.0, 10.0)
    unheard = [
        STATUS,
        replace(status, attitude_s=-math.inf),
        replace(status, velocity_w_mps=np.full(3, math.nan)),
        replace(status, rate_flu_radps=np.full(3, math.nan)),
    ]
    assert all(step(nothing, one, pose, PARAMS) is nothing for one in unheard)
    assert step(nothing, status, None, PARAMS) is nothing
    lost = replace(pose, position_w_m=np.array([0.0, math.nan, 0.0]))
    assert step(nothing, status, lost, PARAMS) is nothing
    assert vision_of(nothing, pose, 10.0) is None
    begun = step(nothing, status, pose, PARAMS)
    assert (begun.verdict, begun.counts.started) == (Verdict.STARTED, 1)


def test_a_pose_counts_once_and_an_older_one_not_at_all() -> None:
    state = estimates(1.0)[-1]
    status = status_at(10.99, 10.99)
    assert step(state, status, None, PARAMS).counts == state.counts
    for again in (pose_at(state.stamp_s), pose_at(state.stamp_s - POSE_EVERY_S)):
        assert step(state, status, again, PARAMS).counts == state.counts
    newer = step(state, status, pose_at(10.99), PARAMS)
    assert (newer.counts.accepted, newer.run) == (state.counts.accepted + 1, state.run + 1)


def test_a_pose_that_no_velocity_explains_begins_the_estimate_anew() -> None:
    state, status = estimates(3.0)[-1], status_at(13.0, 13.0)
    far = replace(pose_at(13.0), position_w_m=place(13.0) + np.array([0.0, 0.5, 0.0]))
    after = step(state, status, far, PARAMS)
    assert (after.verdict, after.run, after.velocity_off_w_mps) == (Verdict.STARTED, 1, (0.0, 0.0, 0.0))
    assert after.vehicle is not None
    assert after.vehicle.position_w_m == pytest.approx(far.position_w_m, abs=0.01)
    assert after.counts.accepted == state.counts.accepted


def test_an_old_velocity_makes_the_estimate_old() -> None:
    fresh, old = (step(EstimatorState(), status_at(12.0, at_s), pose_at(12.0), PARAMS).vehicle for at_s in (11.9, 11.0))
    assert fresh is not None
    assert old is not None
    assert (fresh.time_s, old.time_s) == pytest.approx((12.0, 11.15))


def test_what_the_autopilot_is_given_is_the_grounds_pose_of_some_time_ago_with_the_tilt_as_it_is() -> None:
    state = estimates(6.0, radio_s=0.05)[-1]
    pose = pose_at(state.stamp_s)
    seen = vision_of(state, pose, 15.98)
    assert seen is not None
    assert seen.time_s == 15.98
    assert math.dist(seen.position_w_m, place(15.98)) < 0.03
    assert float(yaw_of(seen.q_w_flu_wxyz)) == pytest.approx(math.remainder(TURN_RADPS * 15.98, math.tau), abs=0.002)
    assert state.vehicle is not None
    assert up_axis(seen.q_w_flu_wxyz) == pytest.approx(up_axis(state.vehicle.q_w_flu_wxyz), abs=0.002)


def test_the_heading_given_is_the_grounds_whatever_the_autopilot_believes() -> None:
    """It is what turns the autopilot's heading into that of W."""
    status = replace(status_at(10.0, 10.0), q_w_flu_wxyz=quat_from_yaw(-2.0), rate_flu_radps=np.zeros(3))
    state = step(EstimatorState(), status, pose_at(10.0), PARAMS)
    seen = vision_of(state, pose_at(10.0), 10.01)
    assert seen is not None
    assert float(yaw_of(seen.q_w_flu_wxyz)) == pytest.approx(pose_at(10.0).yaw_rad)
