"""Plans keep limits and distances, begin where the arms are, and refuse with the reason."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.arms.collision import clearance, distances
from companion.arms.model import ArmModel, JointLimit
from companion.arms.planning import OWN_PACE, grip, plan, to_pose
from companion.arms.trajectory import Hold, JointTrajectory, Sinusoid, Slowed, Waypoints, minimum_jerk
from companion.config.arms_config import PosesConfig
from companion.core.interfaces import ArmError
from companion.core.types import Array, JointMotion
from tests.arms.poses import joints, vectors

MODEL = ArmModel()
LOW, HIGH, SPEED, ACCEL = MODEL.limit_arrays()


def both(chain: tuple[float, float, float], claw: float = 0.5) -> Array:
    return np.array([*chain, claw, *chain, claw])


HOME, STOW = both(PosesConfig().home_rad), both(PosesConfig().stow_rad)
INWARD = both((0.0, 0.0, -0.55))
"""Both forearms turned inward: not quite touching."""

swings = st.builds(
    lambda amplitude, period, phase, duration, fade: Sinusoid(HOME, amplitude, period, phase, duration, fade),
    vectors(0.25),
    vectors(1.0).map(lambda v: 0.3 + 2.0 * np.abs(v)),
    vectors(3.0),
    st.floats(0.5, 12.0),
    st.floats(0.1, 4.0),
)


@st.composite
def courses(draw: st.DrawFn) -> JointTrajectory:
    """Waypoints near home, some of them in a great hurry."""
    poses = np.stack([HOME + draw(vectors(0.15)) for _ in range(draw(st.integers(2, 6)))])
    spans = draw(st.lists(st.floats(0.05, 2.0), min_size=len(poses) - 1, max_size=len(poses) - 1))
    return Waypoints(np.append(0.0, np.cumsum(spans)), poses, draw(st.booleans()))


def at_random_times(motion: JointTrajectory, count: int = 2000) -> JointMotion:
    return motion.at(np.random.default_rng(3).uniform(0.0, motion.duration_s, count))


@settings(max_examples=60)
@given(motion=st.one_of(swings, courses()))
def test_a_planned_motion_keeps_every_velocity_and_acceleration_limit(motion: JointTrajectory) -> None:
    found = at_random_times(plan(MODEL, motion, STOW, (HOME,)).trajectory)
    assert np.all(np.abs(found.velocity_radps) <= SPEED * (1.0 + 1e-9))
    assert np.all(np.abs(found.acceleration_radps2) <= ACCEL * (1.0 + 1e-9))
    assert np.all(found.position_rad >= LOW - 1e-3)
    assert np.all(found.position_rad <= HIGH + 1e-3)


@settings(max_examples=60)
@given(motion=st.one_of(swings, courses()))
def test_a_plan_runs_the_motion_itself_after_an_approach_from_where_the_arms_are(motion: JointTrajectory) -> None:
    made = plan(MODEL, motion, STOW)
    begun = made.trajectory.at(0.0)
    np.testing.assert_allclose(begun.position_rad, STOW, atol=1e-12)
    np.testing.assert_array_equal(begun.velocity_radps, np.zeros(8))
    for share in (0.0, 0.3, 0.8, 1.0):
        wanted = motion.at(share * motion.duration_s).position_rad
        time_s = made.approach_s + share * motion.duration_s * made.slowed_by
        np.testing.assert_allclose(made.trajectory.at(time_s).position_rad, wanted, atol=1e-6)


@settings(max_examples=25)
@given(amplitude=vectors(1.2), centre=vectors(0.6))
def test_what_is_accepted_keeps_its_distance_and_what_is_refused_would_not(amplitude: Array, centre: Array) -> None:
    free = replace(MODEL, limits=(JointLimit(-3.0, 3.0, 3.0, 20.0),) * 4)
    swing = Sinusoid(HOME + centre, amplitude, np.full(8, 3.0), np.linspace(0.0, 3.0, 8), 6.0)
    try:
        found = at_random_times(plan(free, swing, HOME + centre).trajectory)
    except ArmError:
        slowest = Slowed(swing, 3.0)
        assert distances(free, at_random_times(slowest, 4000).position_rad).distance_m.min() < free.margin_m + 1e-3
    else:
        assert distances(free, found.position_rad).distance_m.min() >= 0.75 * free.margin_m


within_limits = st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8).map(lambda share: LOW + share * (HIGH - LOW))


@given(start=within_limits, goal=within_limits)
def test_a_way_between_poses_within_the_limits_never_leaves_them(start: Array, goal: Array) -> None:
    nothing_near = replace(MODEL, shoulder_flu_m=(0.0, 2.0, -2.0))
    way = to_pose(nothing_near, start, goal).trajectory
    found = at_random_times(way)
    np.testing.assert_allclose(way.at(0.0).position_rad, start, atol=1e-9)
    np.testing.assert_allclose(way.at(way.duration_s).position_rad, goal, atol=1e-9)
    assert np.all(found.position_rad >= np.minimum(start, goal) - 1e-9)
    assert np.all(found.position_rad <= np.maximum(start, goal) + 1e-9)
    assert np.all(np.abs(found.velocity_radps) <= OWN_PACE * SPEED * (1.0 + 1e-9))
    assert np.all(np.abs(found.acceleration_radps2) <= OWN_PACE * ACCEL * (1.0 + 1e-6))


def test_what_is_within_the_limits_is_not_slowed_and_has_nothing_to_tell() -> None:
    swing = Sinusoid(HOME, joints(right_shoulder_pitch=0.4), np.full(8, 4.0), np.zeros(8), 20.0)
    made = plan(MODEL, swing, HOME)
    assert made.slowed_by == 1.0
    assert made.notes == ()
    assert made.trajectory.duration_s == 20.0


def test_slowing_is_told_with_the_joint_its_velocity_and_how_long_it_takes() -> None:
    quick = minimum_jerk(HOME, HOME + joints(left_elbow_pitch=0.8), 0.4)
    # peak 15/8 * 0.8 / 0.4 = 3.75 rad/s and 5.7735 * 0.8 / 0.16 = 28.9 rad/s^2: the velocity asks for 1.26 times
    made = plan(MODEL, quick, HOME)
    assert made.slowed_by == pytest.approx(1.01 * 3.75 / 3.0)
    assert made.notes == (
        "slowed down 1.26 times, 0.5 s instead of 0.4 s: left.elbow_pitch would turn at 3.75 rad/s, allowed is 3 rad/s",
    )


def test_slowing_for_an_acceleration_is_told_as_such() -> None:
    shake = Sinusoid(HOME, joints(right_elbow_roll=0.1), np.full(8, 0.4), np.zeros(8), 6.0, 1.0)
    made = plan(MODEL, shake, HOME)
    assert made.slowed_by == pytest.approx((1.01 * 0.1 * (2.0 * np.pi / 0.4) ** 2 / 20.0) ** 0.5, rel=0.01)
    assert "right.elbow_roll would take 24." in made.notes[0]
    assert "allowed is 20 rad/s^2" in made.notes[0]


def test_a_joint_limit_is_refused_with_joint_angle_limit_and_time() -> None:
    high = minimum_jerk(HOME, HOME + joints(left_elbow_roll=1.5), 2.0)
    with pytest.raises(ArmError) as caught:
        plan(MODEL, high, HOME)
    said = str(caught.value)
    assert "s into the motion left.elbow_roll would be at 1.2" in said
    assert said.endswith("allowed is -0.600 rad (-34.4 deg) to 1.200 rad (68.8 deg)")


def test_a_collision_is_refused_with_the_pair_the_time_and_the_distance() -> None:
    inward = minimum_jerk(HOME, HOME + joints(right_elbow_roll=-0.6, left_elbow_roll=-0.6), 2.0)
    with pytest.raises(
        ArmError, match=r"^[12]\.\d\d s into the motion right forearm and left forearm would come within"
    ):
        plan(MODEL, inward, HOME)


def test_a_thin_obstacle_crossed_at_speed_is_not_missed() -> None:
    # the forearm sweeps from below to above a small disc within a fraction of a second
    small = replace(MODEL.propellers, count=2, radius_m=0.01, centre_m=0.3, first_rad=0.415, height_m=-0.05)
    model = replace(MODEL, propellers=small, link_radius_m=0.001, margin_m=0.005)
    low, high = (joints(left_shoulder_pitch=1.2, left_elbow_pitch=bend) for bend in (-0.2, 1.5))
    assert clearance(model, low).distance_m > 0.02
    assert clearance(model, high).distance_m > 0.02
    with pytest.raises(ArmError, match="left forearm and a propeller"):
        plan(model, minimum_jerk(low, high, 1.1), low)


def test_the_approach_is_checked_as_well() -> None:
    # the left arm has to pass through the right forearm's place to reach the motion's start
    crossed = replace(MODEL, limits=(*MODEL.limits[:2], JointLimit(-1.5, 1.5, 3.0, 20.0), MODEL.limits[3]))
    start = both((0.0, 0.0, 0.0)) + joints(left_elbow_roll=-1.3, left_shoulder_pitch=0.6, right_elbow_roll=-0.9)
    goal = start + joints(left_shoulder_pitch=-1.2)
    assert min(clearance(crossed, pose).distance_m for pose in (start, goal)) > crossed.margin_m
    with pytest.raises(ArmError, match=r"s into the way there .*forearm and left .* would"):
        plan(crossed, Hold(goal, 1.0), start)
    with pytest.raises(ArmError, match="into the way there"):
        to_pose(crossed, start, goal)


def test_a_way_that_is_barred_is_taken_through_a_free_pose_and_the_detour_is_told() -> None:
    crossed = replace(MODEL, limits=(*MODEL.limits[:2], JointLimit(-1.5, 1.5, 3.0, 20.0), MODEL.limits[3]))
    start = both((0.0, 0.0, 0.0)) + joints(left_elbow_roll=-1.3, left_shoulder_pitch=0.6, right_elbow_roll=-0.9)
    goal = start + joints(left_shoulder_pitch=-1.2)
    made = to_pose(crossed, start, goal, (both((0.0, 0.0, 0.0)),))
    assert "round about" in made.notes[0]
    found = at_random_times(made.trajectory)
    assert distances(crossed, found.position_rad).distance_m.min() > 0.75 * crossed.margin_m
    np.testing.assert_allclose(made.trajectory.at(made.trajectory.duration_s).position_rad, goal)


def test_a_pose_that_touches_is_refused_as_a_pose() -> None:
    with pytest.raises(ArmError) as caught:
        to_pose(MODEL, HOME, both((0.0, 0.0, -0.6)))
    assert str(caught.value) == (
        "in the pose asked for right forearm and left forearm would come within 0.018 m, 0.020 m is to be kept"
    )


def test_arms_that_begin_too_near_to_something_may_leave_it_but_not_go_nearer() -> None:
    stuck = both((0.0, 0.0, -0.6))
    free = to_pose(MODEL, stuck, HOME).trajectory
    assert clearance(MODEL, free.at(free.duration_s).position_rad).distance_m > MODEL.margin_m
    wide = replace(MODEL, limits=(*MODEL.limits[:2], JointLimit(-1.0, 1.0, 3.0, 20.0), MODEL.limits[3]))
    with pytest.raises(ArmError, match="right forearm and left forearm"):
        to_pose(wide, stuck, both((0.0, 0.0, -0.65)))


def test_arms_that_sag_beyond_a_limit_may_come_back() -> None:
    sagged = STOW + joints(right_shoulder_pitch=-1.2)
    assert sagged[0] < LOW[0]
    way = to_pose(MODEL, sagged, STOW).trajectory
    np.testing.assert_allclose(way.at(0.0).position_rad, sagged)


def test_the_floor_is_kept_away_from() -> None:
    with pytest.raises(ArmError, match="and the floor would"):
        to_pose(MODEL, STOW, np.zeros(8), floor_z_m=-0.4)
    assert to_pose(MODEL, STOW, np.zeros(8)).notes == ()


def test_going_where_the_arms_are_is_standing_still() -> None:
    still = to_pose(MODEL, HOME, HOME).trajectory
    np.testing.assert_array_equal(still.at(0.1).position_rad, HOME)
    np.testing.assert_array_equal(still.at(0.1).velocity_radps, np.zeros(8))


@pytest.mark.parametrize("claw_rad", [PosesConfig().claw_open_rad, PosesConfig().claw_closed_rad])
def test_gripping_moves_the_claws_alone(claw_rad: float) -> None:
    found = grip(MODEL, HOME, claw_rad).trajectory
    end = found.at(found.duration_s).position_rad
    np.testing.assert_allclose(end[[3, 7]], claw_rad)
    others = [0, 1, 2, 4, 5, 6]
    np.testing.assert_array_equal(at_random_times(found).position_rad[:, others], np.tile(HOME[others], (2000, 1)))


def test_a_claw_beyond_its_limit_is_refused() -> None:
    with pytest.raises(ArmError, match=r"right\.claw would be at 1\.800 rad .* to 1\.000 rad"):
        grip(MODEL, HOME, 1.8)


def test_a_joint_that_was_never_read_is_not_moved() -> None:
    unread = HOME.copy()
    unread[5] = np.nan
    with pytest.raises(ArmError, match=r"left\.elbow_pitch is, is not known"):
        to_pose(MODEL, unread, STOW)


def test_a_motion_without_end_and_one_that_is_no_number_are_refused() -> None:
    with pytest.raises(ArmError, match="inf s cannot be checked"):
        plan(MODEL, Hold(HOME, float("inf")), HOME)
    with pytest.raises(ArmError, match="not numbers"):
        plan(MODEL, Hold(HOME * np.nan, 1.0), HOME)
