"""Joint trajectories: derivatives are derivatives, ends are at rest, one time is as many."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.arms.trajectory import Hold, InTurn, JointTrajectory, Sinusoid, Slowed, Waypoints, minimum_jerk

RNG = np.random.default_rng(7)
A, B, C = RNG.uniform(-1.0, 1.0, (3, 8))
SWING = Sinusoid(A, 0.5 * np.abs(B), np.full(8, 3.0), np.linspace(0.0, 2.0, 8), 10.0)
STEP = minimum_jerk(A, B, 2.0)
STOPS = Waypoints(np.array([0.0, 1.0, 2.5, 3.0]), np.stack((A, B, C, A)))
PASSES = Waypoints(np.array([0.0, 1.0, 2.5, 3.0, 5.0]), np.stack((A, B, B + 0.5 * (B - A), C, A)), stop=False)
RESTING: dict[str, JointTrajectory] = {
    "hold": Hold(A, 1.0),
    "minimum jerk": STEP,
    "stops": STOPS,
    "passes": PASSES,
    "sinusoid": SWING,
    "short sinusoid": Sinusoid(A, B, np.full(8, 1.0), np.zeros(8), 1.5),
    "slowed": Slowed(PASSES, 1.7),
    "in turn": InTurn((STEP, Hold(B, 0.5), minimum_jerk(B, A, 1.0), Slowed(STEP, 1.2))),
}
every = pytest.mark.parametrize("motion", RESTING.values(), ids=RESTING.keys())


@every
def test_velocity_and_acceleration_are_the_derivatives(motion: JointTrajectory) -> None:
    h = 1e-5
    times = np.linspace(0.0, motion.duration_s, 400)[1:-1] + 1e-4
    before, here, after = (motion.at(times + d) for d in (-h, 0.0, h))
    slope = (after.position_rad - before.position_rad) / (2.0 * h)
    bend = (after.velocity_radps - before.velocity_radps) / (2.0 * h)
    np.testing.assert_allclose(here.velocity_radps, slope, atol=1e-6)
    np.testing.assert_allclose(here.acceleration_radps2, bend, atol=2e-3)


@every
def test_it_starts_and_stops_at_rest_without_acceleration(motion: JointTrajectory) -> None:
    for time_s in (0.0, motion.duration_s):
        ends = motion.at(time_s)
        np.testing.assert_allclose(ends.velocity_radps, 0.0, atol=1e-9)
        np.testing.assert_allclose(ends.acceleration_radps2, 0.0, atol=1e-9)


@every
def test_outside_its_time_it_rests_at_its_ends(motion: JointTrajectory) -> None:
    for beyond, end in ((-0.5, 0.0), (motion.duration_s + 0.5, motion.duration_s)):
        outside = motion.at(beyond)
        np.testing.assert_allclose(outside.position_rad, motion.at(end).position_rad, atol=1e-12)
        np.testing.assert_array_equal(outside.velocity_radps, np.zeros(8))
        np.testing.assert_array_equal(outside.acceleration_radps2, np.zeros(8))


@every
def test_many_times_give_the_motions_of_each(motion: JointTrajectory) -> None:
    times = np.linspace(-0.3, motion.duration_s + 0.3, 101)
    many = motion.at(times)
    for place, time_s in enumerate(times.tolist()):
        one = motion.at(time_s)
        for name in ("position_rad", "velocity_radps", "acceleration_radps2"):
            assert getattr(one, name).shape == (8,)
            np.testing.assert_allclose(getattr(many, name)[place], getattr(one, name), atol=1e-9, err_msg=name)


@every
def test_pieces_reach_from_the_start_to_the_end(motion: JointTrajectory) -> None:
    pieces = motion.pieces_s
    assert pieces[0] == 0.0
    assert pieces[-1] == pytest.approx(motion.duration_s)
    assert np.all(np.diff(pieces) > 0.0)


def test_the_middle_of_a_minimum_jerk_step_by_hand() -> None:
    # Flash and Hogan: halfway at half time, with 15/8 of the mean speed
    middle = STEP.at(1.0)
    np.testing.assert_allclose(middle.position_rad, 0.5 * (A + B))
    np.testing.assert_allclose(middle.velocity_radps, 1.875 * (B - A) / 2.0)
    np.testing.assert_allclose(middle.acceleration_radps2, 0.0, atol=1e-12)


def test_waypoints_are_met_at_their_times() -> None:
    for course in (STOPS, PASSES):
        np.testing.assert_allclose(course.at(course.times_s).position_rad, course.positions_rad, atol=1e-12)


def test_stopping_waypoints_rest_at_each_pose() -> None:
    np.testing.assert_allclose(STOPS.at(STOPS.times_s).velocity_radps, 0.0, atol=1e-12)


def test_passing_waypoints_move_as_the_parabola_through_the_neighbours() -> None:
    poses = np.zeros((4, 8))
    poses[:, 0] = (0.0, 1.0, 3.0, 2.0)
    course = Waypoints(np.array([0.0, 1.0, 2.0, 3.0]), poses, stop=False)
    found = course.at(course.times_s)
    np.testing.assert_allclose(found.velocity_radps[:, 0], [0.0, 1.5, 0.5, 0.0], atol=1e-12)
    inside = course.at(np.array([1.0, 2.0]))
    np.testing.assert_allclose(inside.acceleration_radps2[:, 0], [1.0, -3.0], atol=1e-12)


def test_passing_waypoints_stand_still_where_a_joint_has_one_angle_twice() -> None:
    poses = np.zeros((5, 8))
    poses[:, 0] = (0.0, 1.0, 1.0, 0.0, 0.5)
    poses[:, 1] = (0.0, 1.0, 3.0, 3.5, 2.0)
    course = Waypoints(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), poses, stop=False)
    paused = course.at(np.linspace(1.0, 2.0, 21))
    np.testing.assert_array_equal(paused.position_rad[:, 0], 1.0)
    np.testing.assert_array_equal(paused.velocity_radps[:, 0], 0.0)
    assert (paused.velocity_radps[:, 1] > 0.1).all(), "the other joint passes smoothly"


def test_passing_waypoints_follow_a_parabola_exactly_whatever_their_spacing() -> None:
    times = np.array([0.0, 0.7, 1.0, 1.9, 2.2, 3.0])
    course = Waypoints(times, A + B * times[:, None] ** 2, stop=False)
    inside = np.linspace(0.7, 2.2, 50)
    found = course.at(inside)
    np.testing.assert_allclose(found.position_rad, A + B * inside[:, None] ** 2, atol=1e-12)
    np.testing.assert_allclose(found.acceleration_radps2, np.tile(2.0 * B, (50, 1)), atol=1e-9)


@given(angles=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=6), data=st.data())
def test_passing_waypoints_swing_out_by_less_than_the_steps_around_them(
    angles: list[float], data: st.DataObject
) -> None:
    spans = data.draw(st.lists(st.floats(0.01, 5.0), min_size=len(angles) - 1, max_size=len(angles) - 1))
    times, poses = np.append(0.0, np.cumsum(spans)), np.outer(angles, np.ones(8))
    course = Waypoints(times, poses, stop=False)
    steps = np.abs(np.diff(angles))
    for place, (begin, end) in enumerate(pairwise(times.tolist())):
        around = steps[max(place - 1, 0) : place + 2].sum()
        found = course.at(np.linspace(begin, end, 101)).position_rad[:, 0]
        low, high = sorted(angles[place : place + 2])
        assert found.max() <= high + around + 1e-9
        assert found.min() >= low - around - 1e-9


def test_a_swing_between_its_fades_is_the_sinusoid_by_hand() -> None:
    at = SWING.at(5.0)
    turn = 2.0 * math.pi / 3.0
    angle = turn * 5.0 + np.linspace(0.0, 2.0, 8)
    amplitude = 0.5 * np.abs(B)
    np.testing.assert_allclose(at.position_rad, A + amplitude * np.sin(angle))
    np.testing.assert_allclose(at.velocity_radps, amplitude * turn * np.cos(angle), atol=1e-12)
    np.testing.assert_allclose(at.acceleration_radps2, -amplitude * turn**2 * np.sin(angle), atol=1e-12)


def test_half_speed_has_half_the_velocity_and_a_quarter_of_the_acceleration() -> None:
    slow, quick = Slowed(SWING, 2.0), SWING
    assert slow.duration_s == 20.0
    np.testing.assert_allclose(slow.at(8.0).position_rad, quick.at(4.0).position_rad)
    np.testing.assert_allclose(slow.at(8.0).velocity_radps, quick.at(4.0).velocity_radps / 2.0)
    np.testing.assert_allclose(slow.at(8.0).acceleration_radps2, quick.at(4.0).acceleration_radps2 / 4.0)
