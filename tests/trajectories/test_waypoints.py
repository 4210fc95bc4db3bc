"""Paths through waypoints that a person wrote: pauses stand still, and the heading does not swing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.trajectories.waypoints import Waypoints

PAUSED = Waypoints(
    np.array([0.0, 4.0, 8.0, 12.0]),
    np.array([[0.0, 0.0, 1.2], [0.8, 0.0, 1.2], [0.8, 0.0, 1.2], [0.0, 0.0, 1.2]]),
    np.array([0.0, 0.0, 1.5, 1.5]),
)


def headings(path: Waypoints, times_s: Array) -> Array:
    return np.array([path.at(float(time_s)).yaw_rad for time_s in times_s])


def test_between_two_waypoints_at_one_place_it_stands_exactly_there() -> None:
    for time_s in np.linspace(4.0, 8.0, 41):
        at = PAUSED.at(float(time_s))
        np.testing.assert_array_equal(at.position_w_m, [0.8, 0.0, 1.2])
        np.testing.assert_array_equal(at.velocity_w_mps, np.zeros(3))
        np.testing.assert_array_equal(at.acceleration_w_mps2, np.zeros(3))


def test_before_and_after_a_pause_it_moves_as_a_path_of_its_own() -> None:
    alone = Waypoints(PAUSED.times_s[:2], PAUSED.positions_w_m[:2], np.zeros(2))
    back = Waypoints(PAUSED.times_s[2:] - 8.0, PAUSED.positions_w_m[2:], np.zeros(2))
    for time_s in np.linspace(0.0, 4.0, 21):
        for part, at_s in ((alone, time_s), (back, time_s + 8.0)):
            here, wanted = PAUSED.at(float(at_s)), part.at(float(time_s))
            np.testing.assert_allclose(here.position_w_m, wanted.position_w_m, atol=1e-12)
            np.testing.assert_allclose(here.acceleration_w_mps2, wanted.acceleration_w_mps2, atol=1e-12)


def test_a_pause_comes_and_goes_without_a_jump_in_velocity_or_acceleration() -> None:
    bent = Waypoints(
        np.array([0.0, 1.0, 3.0, 5.0, 6.5, 8.0]),
        np.array([[0, 0, 1], [0.5, 0.4, 1], [1, 0, 1.2], [1, 0, 1.2], [0.5, -0.5, 1.1], [0, 0, 1]], dtype=float),
        np.zeros(6),
    )
    for knot_s in (1.0, 3.0, 5.0, 6.5):
        before, after = bent.at(knot_s - 1e-7), bent.at(knot_s + 1e-7)
        np.testing.assert_allclose(before.velocity_w_mps, after.velocity_w_mps, atol=1e-5)
        np.testing.assert_allclose(before.acceleration_w_mps2, after.acceleration_w_mps2, atol=1e-4)


def test_it_may_wait_at_its_begin_and_at_its_end() -> None:
    waiting = Waypoints(
        np.array([0.0, 2.0, 4.0, 7.0]),
        np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]),
        np.zeros(4),
    )
    assert [waiting.at(t).position_w_m[0] for t in (1.0, 2.0, 3.0, 4.0, 5.5)] == pytest.approx([0, 0, 0.5, 1, 1])


def test_a_heading_that_is_to_change_at_once_does_not_swing_beyond() -> None:
    """3 rad in 0.3 s, then 5.7 s of rest: a spline that is smooth to the snap went to 78 rad there."""
    quick = Waypoints(np.array([0.0, 0.3, 6.0]), np.zeros((3, 3)), np.array([0.0, 3.0, 3.0]))
    turned = headings(quick, np.linspace(0.0, 6.0, 1201))
    assert turned.min() == 0.0
    assert turned.max() == 3.0
    assert headings(quick, np.array([0.15]))[0] == pytest.approx(1.5), "a minimum-jerk step"


def test_a_heading_that_turns_evenly_is_a_straight_line() -> None:
    times_s = np.array([0.0, 1.0, 3.0, 3.5, 6.0, 7.0])
    even = Waypoints(times_s, np.zeros((6, 3)), 0.4 * times_s)
    inner = np.linspace(1.0, 6.0, 101)
    np.testing.assert_allclose(headings(even, inner), 0.4 * inner, atol=1e-12)


def test_a_heading_that_was_sampled_is_followed_closely() -> None:
    times_s = np.arange(0.0, 20.05, 0.1)
    wanted = 0.5 - 0.5 * np.cos(0.2 * np.pi * times_s)
    path = Waypoints(times_s, np.zeros((len(times_s), 3)), wanted)
    between = times_s[:-1] + 0.05
    np.testing.assert_allclose(headings(path, between), 0.5 - 0.5 * np.cos(0.2 * np.pi * between), atol=2e-4)


@given(
    spans=st.lists(st.floats(0.01, 10.0), min_size=2, max_size=7),
    turns=st.lists(st.one_of(st.just(0.0), st.floats(-3.0, 3.0)), min_size=2, max_size=7),
)
def test_a_heading_stays_between_the_two_it_turns_between_and_never_turns_back(
    spans: list[float], turns: list[float]
) -> None:
    count = min(len(spans), len(turns))
    times_s = np.concatenate(([0.0], np.cumsum(spans[:count])))
    yaws_rad = np.concatenate(([0.0], np.cumsum(turns[:count])))
    path = Waypoints(times_s, np.zeros((count + 1, 3)), yaws_rad)
    for number in range(count):
        begin, end = yaws_rad[number : number + 2]
        turned = headings(path, np.linspace(times_s[number], times_s[number + 1] - 1e-9, 40))
        assert min(begin, end) - 1e-6 <= turned.min()
        assert turned.max() <= max(begin, end) + 1e-6
        assert (np.diff(turned) * np.sign(end - begin) >= -1e-9).all()


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 9))
def test_a_heading_turns_without_a_jump_in_its_rate_or_its_acceleration(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    times_s = np.concatenate(([0.0], np.cumsum(rng.uniform(0.3, 3.0, count - 1))))
    path = Waypoints(times_s, np.zeros((count, 3)), np.cumsum(rng.uniform(-1.5, 1.5, count)))
    h = 1e-4
    for knot_s in times_s[1:-1]:
        before, after = (headings(path, knot_s + side * h * np.arange(3.0)) for side in (-1.0, 1.0))
        rates = (before[0] - before[1]) / h, (after[1] - after[0]) / h
        accels = [(one[0] - 2.0 * one[1] + one[2]) / h**2 for one in (before, after)]
        assert rates[0] == pytest.approx(rates[1], abs=0.05)
        assert accels[0] == pytest.approx(accels[1], abs=0.5)
