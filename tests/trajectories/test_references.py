"""Reference trajectories: their derivatives are those of their positions, and nothing jumps."""

import math
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.trajectories.reference import (
    Descent,
    Ellipse,
    FigureEight,
    Hold,
    LapTiming,
    MinimumJerk,
    Trajectory,
    minimum_jerk_duration_s,
)
from companion.trajectories.waypoints import Waypoints

CENTRE = np.array([0.5, -0.2, 1.2])
WAYPOINTS = Waypoints(
    np.array([0.0, 2.0, 3.5, 6.0]),
    np.array([[0.0, 0.0, 1.0], [1.0, 0.5, 1.2], [0.5, 1.0, 1.5], [0.0, 0.0, 1.0]]),
    np.array([0.0, 1.0, 3.0, -3.0]),
)
CURVES: list[Trajectory] = [
    Ellipse(CENTRE),
    FigureEight(CENTRE),
    Ellipse(CENTRE, timing=LapTiming(4.0, 1, 4.0)),
    FigureEight(CENTRE, (0.4, 0.3), LapTiming(9.0, 3, 2.0)),
    MinimumJerk(
        start_w_m=np.zeros(3), end_w_m=np.array([1.0, -2.0, 0.5]), duration_s=3.0, start_yaw_rad=3.0, end_yaw_rad=-3.0
    ),
    WAYPOINTS,
]
STARTED: list[Trajectory] = [
    MinimumJerk(
        start_w_m=np.zeros(3),
        end_w_m=np.ones(3),
        duration_s=2.5,
        start_velocity_w_mps=np.array([0.4, -0.2, 0.1]),
        start_acceleration_w_mps2=np.array([0.1, 0.3, -0.2]),
    ),
    Descent(
        start_w_m=np.array([0.0, 0.0, 1.0]),
        velocity_w_mps=np.array([0.3, -0.2, 0.4]),
        speed_mps=0.25,
        yaw_rad=0.5,
        duration_s=5.0,
    ),
]
NAMES = ["ellipse", "eight", "quickest ellipse", "three eights", "minimum jerk", "waypoints"]
STARTED_NAMES = ["minimum jerk begun in flight", "descent begun in flight"]


def table(trajectory: Trajectory, step_s: float) -> tuple[Array, Array, Array, Array]:
    times = np.arange(-0.2, trajectory.duration_s + 0.2, step_s)
    refs = [trajectory.at(float(t)) for t in times]
    p, v, a = (
        np.array([getattr(r, name) for r in refs]) for name in ("position_w_m", "velocity_w_mps", "acceleration_w_mps2")
    )
    return times, p, v, a


@pytest.mark.parametrize("trajectory", CURVES + STARTED, ids=NAMES + STARTED_NAMES)
def test_velocity_and_acceleration_are_the_derivatives(trajectory: Trajectory) -> None:
    h = 1e-4
    for t in np.linspace(0.01, trajectory.duration_s - 0.01, 301):
        before, here, after = (trajectory.at(float(t) + d) for d in (-h, 0.0, h))
        v = (after.position_w_m - before.position_w_m) / (2 * h)
        a = (after.velocity_w_mps - before.velocity_w_mps) / (2 * h)
        np.testing.assert_allclose(here.velocity_w_mps, v, atol=1e-6, err_msg=f"at {t:.3f} s")
        np.testing.assert_allclose(here.acceleration_w_mps2, a, atol=1e-6, err_msg=f"at {t:.3f} s")


@pytest.mark.parametrize("trajectory", CURVES, ids=NAMES)
def test_it_starts_and_stops_at_rest_and_holds_its_ends(trajectory: Trajectory) -> None:
    for end, beyond in ((0.0, -5.0), (trajectory.duration_s, trajectory.duration_s + 5.0)):
        for t in (end, beyond):
            np.testing.assert_allclose(trajectory.at(t).velocity_w_mps, np.zeros(3), atol=1e-9)
            np.testing.assert_allclose(trajectory.at(t).acceleration_w_mps2, np.zeros(3), atol=1e-9)
        np.testing.assert_allclose(trajectory.at(beyond).position_w_m, trajectory.at(end).position_w_m, atol=1e-9)


@pytest.mark.parametrize("trajectory", CURVES, ids=NAMES)
def test_the_third_derivative_is_bounded(trajectory: Trajectory) -> None:
    """Property 2 of the paper: a jump in the acceleration would make this grow tenfold with a tenth of the step."""
    jerks = []
    for step_s in (0.01, 0.001):
        _, _, _, a = table(trajectory, step_s)
        jerks.append(float(np.abs(np.diff(a, axis=0)).max()) / step_s)
    assert jerks[1] < 1.5 * jerks[0] + 1e-6


def test_a_move_begun_in_flight_takes_over_the_motion_and_ends_at_rest() -> None:
    move = STARTED[0]
    start, end = move.at(0.0), move.at(2.5)
    np.testing.assert_allclose(start.position_w_m, np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(start.velocity_w_mps, [0.4, -0.2, 0.1], atol=1e-12)
    np.testing.assert_allclose(start.acceleration_w_mps2, [0.1, 0.3, -0.2], atol=1e-12)
    np.testing.assert_allclose(end.position_w_m, np.ones(3), atol=1e-12)
    np.testing.assert_allclose(end.velocity_w_mps, np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(end.acceleration_w_mps2, np.zeros(3), atol=1e-12)


def test_the_ellipse_by_hand() -> None:
    # after the ramp the phase is 2 pi (t - 2) / 15: a quarter lap at t = 2 + 3.75
    at = Ellipse(CENTRE).at(5.75)
    w = 2.0 * math.pi / 15.0
    np.testing.assert_allclose(at.position_w_m, [0.5, 0.4, 1.2], atol=1e-12)
    np.testing.assert_allclose(at.velocity_w_mps, [-w, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(at.acceleration_w_mps2, [0.0, -0.6 * w * w, 0.0], atol=1e-12)
    np.testing.assert_allclose(Ellipse(CENTRE).at(0.0).position_w_m, [1.5, -0.2, 1.2])


def test_the_eight_by_hand() -> None:
    # three eighths of a lap at t = 2 + 5.625: x = sin 135, y = 0.5 sin 270
    at = FigureEight(CENTRE).at(7.625)
    np.testing.assert_allclose(at.position_w_m, [0.5 + math.sqrt(0.5), -0.7, 1.2], atol=1e-12)
    np.testing.assert_allclose(FigureEight(CENTRE).at(0.0).position_w_m, CENTRE)


@given(period=st.floats(4.0, 60.0), laps=st.integers(1, 5), ramp=st.floats(0.1, 4.0))
def test_the_laps_are_whole(period: float, laps: int, ramp: float) -> None:
    timing = LapTiming(period, laps, ramp)
    assert timing.phase(0.0) == (0.0, 0.0, 0.0)
    assert timing.phase(timing.duration_s)[0] == pytest.approx(2.0 * math.pi * laps)
    angles = [timing.phase(t)[0] for t in np.linspace(0.0, timing.duration_s, 200)]
    assert all(b >= a - 1e-12 for a, b in pairwise(angles))


@given(distance=st.floats(0.0, 20.0), speed=st.floats(0.05, 3.0), accel=st.floats(0.1, 5.0))
def test_a_move_stays_within_its_speed_and_acceleration(distance: float, speed: float, accel: float) -> None:
    duration = minimum_jerk_duration_s(distance, speed, accel)
    assert duration >= 1.0
    move = MinimumJerk(start_w_m=np.zeros(3), end_w_m=np.array([distance, 0.0, 0.0]), duration_s=duration)
    for t in np.linspace(0.0, duration, 101):
        at = move.at(float(t))
        assert abs(at.velocity_w_mps[0]) <= speed * (1.0 + 1e-9)
        assert abs(at.acceleration_w_mps2[0]) <= accel * (1.0 + 1e-4)


def test_a_move_turns_the_shorter_way() -> None:
    move = MinimumJerk(start_w_m=np.zeros(3), end_w_m=np.ones(3), duration_s=2.0, start_yaw_rad=3.0, end_yaw_rad=-3.0)
    assert move.at(1.0).yaw_rad == pytest.approx(math.pi)
    assert move.at(2.0).yaw_rad == pytest.approx(2.0 * math.pi - 3.0)


def test_the_waypoints_are_flown_through_at_their_times() -> None:
    for t, point, yaw in zip(WAYPOINTS.times_s, WAYPOINTS.positions_w_m, WAYPOINTS.yaws_rad, strict=True):
        at = WAYPOINTS.at(float(t))
        np.testing.assert_allclose(at.position_w_m, point, atol=1e-9)
        assert math.remainder(at.yaw_rad - float(yaw), 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_two_waypoints_are_a_minimum_jerk_move() -> None:
    """One quintic with rest at both ends is unique: 10 x^3 - 15 x^4 + 6 x^5."""
    line = Waypoints(np.array([0.0, 2.0]), np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]]), np.zeros(2))
    for x in (0.1, 0.25, 0.5, 0.9):
        share = 10 * x**3 - 15 * x**4 + 6 * x**5
        np.testing.assert_allclose(line.at(2.0 * x).position_w_m, [2.0 * share, 0.0, 1.0], atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 12))
def test_random_waypoints_are_met_without_a_jump(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.concatenate(([0.0], np.cumsum(rng.uniform(0.3, 3.0, count - 1))))
    points = rng.uniform(-2.0, 2.0, (count, 3))
    way = Waypoints(times, points, np.zeros(count))
    for t, point in zip(times, points, strict=True):
        before, after = way.at(float(t) - 1e-7), way.at(float(t) + 1e-7)
        np.testing.assert_allclose(way.at(float(t)).position_w_m, point, atol=1e-6)
        np.testing.assert_allclose(before.velocity_w_mps, after.velocity_w_mps, atol=1e-3)
        np.testing.assert_allclose(before.acceleration_w_mps2, after.acceleration_w_mps2, atol=1e-2)


def test_the_descent_ends_straight_down_at_its_speed() -> None:
    down = Descent(
        start_w_m=np.array([1.0, 2.0, 3.0]), velocity_w_mps=np.array([0.4, 0.0, 0.2]), speed_mps=0.25, yaw_rad=0.7
    )
    np.testing.assert_allclose(down.at(0.0).position_w_m, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(down.at(0.0).velocity_w_mps, [0.4, 0.0, 0.2])
    np.testing.assert_allclose(down.at(-1.0).position_w_m, [1.0, 2.0, 3.0])
    for t in (1.5, 10.0):
        np.testing.assert_allclose(down.at(t).velocity_w_mps, [0.0, 0.0, -0.25], atol=1e-12)
        np.testing.assert_allclose(down.at(t).acceleration_w_mps2, np.zeros(3), atol=1e-12)
    # the share of the descent's rate is on average 1/2 over the 1.5 s of easing: 0.75 s of each motion
    np.testing.assert_allclose(down.at(1.5).position_w_m, [1.3, 2.0, 3.0 + 0.15 - 0.1875], atol=1e-12)
    assert down.at(5.0).yaw_rad == 0.7


def test_holding_is_standing_still() -> None:
    at = Hold(CENTRE, 0.4).at(123.0)
    np.testing.assert_array_equal(at.position_w_m, CENTRE)
    np.testing.assert_array_equal(at.velocity_w_mps, np.zeros(3))
    assert at.yaw_rad == 0.4


def test_a_path_of_many_waypoints_takes_room_by_their_number_and_not_by_its_square() -> None:
    many = np.arange(400.0)
    path = Waypoints(many, np.column_stack((np.cos(many / 20.0), np.sin(many / 20.0), many / 400.0)), np.zeros(400))
    tracemalloc.start()
    path.at(0.0)
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < 1_000_000, "solved while a vehicle flies: the dense system took 46 MB and seconds"


def test_jerk_and_snap_go_on_through_a_waypoint() -> None:
    path = Waypoints(
        np.array([0.0, 1.5, 2.0, 4.0]),
        np.array([[0.0, 0.0, 1.0], [1.0, 0.5, 1.2], [0.5, 1.0, 1.0], [0.0, 0.0, 1.5]]),
        np.array([0.0, 0.3, -0.2, 0.0]),
    )
    h = 1e-3
    for at_s in (1.5, 2.0):
        before, after = ([path.at(at_s + side * n * h).acceleration_w_mps2 for n in range(3)] for side in (-1, 1))
        jerks = [(one[0] - one[1]) / h * side for one, side in ((before, 1.0), (after, -1.0))]
        snaps = [(one[0] - 2.0 * one[1] + one[2]) / h**2 for one in (before, after)]
        np.testing.assert_allclose(jerks[0], jerks[1], rtol=0.01, atol=0.5)
        np.testing.assert_allclose(snaps[0], snaps[1], rtol=0.05, atol=2.0)
