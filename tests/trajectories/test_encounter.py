"""Distance of two ways in space and time: values, and properties against a dense search."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.types import Array
from companion.trajectories.encounter import Cylinder, crossing, meeting
from companion.trajectories.timed_path import TimedPath, sampled

CYLINDER = Cylinder(1.2, 1.6)


def path(*knots: tuple[float, float, float, float]) -> TimedPath:
    rows = np.array(knots)
    return TimedPath(rows[:, 0], rows[:, 1:])


EAST = path((0.0, -3.0, 0.0, 1.0), (6.0, 3.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("own", "because"),
    [
        (path((0.0, 0.0, 1.3, 1.0), (6.0, 0.0, 1.3, 1.0)), "it stands beside the way"),
        (path((0.0, -3.0, 1.3, 1.0), (6.0, 3.0, 1.3, 1.0)), "side by side"),
        (path((0.0, -3.0, 0.0, 2.7), (6.0, 3.0, 0.0, 2.7)), "one above the other, higher than the cylinder"),
        (path((8.0, 0.0, -3.0, 1.0), (14.0, 0.0, 3.0, 1.0)), "it crosses the way when the other has passed"),
    ],
)
def test_ways_that_never_meet(own: TimedPath, because: str) -> None:
    assert meeting(own, EAST, CYLINDER) is None, because


def test_head_on_they_meet_in_the_middle() -> None:
    met = meeting(path((0.0, 3.0, 0.0, 1.0), (6.0, -3.0, 0.0, 1.0)), EAST, CYLINDER)
    assert met is not None
    assert met.distance_m == pytest.approx(0.0, abs=1e-9)
    assert met.time_s == pytest.approx(3.0)
    assert met.position_w_m == pytest.approx([0.0, 0.0, 1.0])


def test_a_path_of_one_knot_is_a_place() -> None:
    met = meeting(path((0.0, 0.0, 0.5, 1.0)), EAST, CYLINDER)
    assert met is not None
    assert met.distance_m == pytest.approx(0.5)
    assert meeting(path((0.0, 0.0, 0.5, 3.0)), EAST, CYLINDER) is None


def test_one_that_comes_to_where_the_other_holds_at_its_end_meets_it_at_any_time() -> None:
    late = path((60.0, 3.0, 4.0, 1.0), (64.0, 3.0, 0.5, 1.0))
    met = meeting(late, EAST, CYLINDER)
    assert met is not None
    assert (met.time_s, met.distance_m) == pytest.approx((64.0, 0.5))


def test_being_half_a_second_late_is_allowed_for() -> None:
    ahead = path((0.0, -1.6, 0.0, 1.0), (4.6, 3.0, 0.0, 1.0), (5.0, 3.0, 4.0, 1.0))
    met = meeting(ahead, EAST, CYLINDER)
    assert met is not None
    assert met.distance_m == pytest.approx(0.4, abs=0.01)  # 1.4 m ahead of it, 0.4 m when it is 1 s early


def test_the_height_difference_counts_only_where_it_is_small() -> None:
    diving = path((0.0, 0.0, 0.0, 6.0), (3.0, 0.0, 0.0, 6.0), (8.0, 0.0, 0.0, 1.0))
    assert meeting(diving, EAST, CYLINDER) is None, "the other has passed when it is down"
    sooner = path((0.0, 0.0, 0.0, 6.0), (3.0, 0.0, 0.0, 1.0))
    assert meeting(sooner, EAST, CYLINDER) is not None


def test_ways_that_cross_at_other_times_say_where_and_who_is_first() -> None:
    later = path((8.0, 0.0, -3.0, 1.0), (14.0, 0.0, 3.0, 1.0))
    crossed = crossing(later, EAST, CYLINDER)
    assert crossed is not None
    assert crossed.after_s == pytest.approx(8.0 - 2.0 * np.hypot(0.6, 0.6), abs=2.0)
    back = crossing(EAST, later, CYLINDER)
    assert back is not None
    assert back.after_s == pytest.approx(-crossed.after_s)
    assert crossing(path((0.0, 0.0, 4.0, 1.0), (1.0, 1.0, 4.0, 1.0)), EAST, CYLINDER) is None


_PLACE = st.floats(-3.0, 3.0)


@st.composite
def paths(draw: st.DrawFn) -> TimedPath:
    count = draw(st.integers(1, 5))
    gaps_s = draw(st.lists(st.floats(0.2, 3.0), min_size=count, max_size=count))
    points = draw(st.lists(st.tuples(_PLACE, _PLACE, _PLACE), min_size=count, max_size=count))
    return TimedPath(np.cumsum(gaps_s), np.array(points))


def dense(own: TimedPath, other: TimedPath) -> float:
    """Least horizontal distance below the cylinder's height at 4000 instants and all slacks; infinite where none."""
    least = np.inf
    for slack_s in (0.0, -0.5, 0.5, -1.0, 1.0):
        end_s = max(own.times_s[-1], other.times_s[-1]) + 2.0
        times_s = np.linspace(own.times_s[0], end_s, 4000)
        apart = own.at(times_s) - other.at(times_s - slack_s)
        low = np.abs(apart[:, 2]) < CYLINDER.height_m
        distances: Array = np.hypot(apart[low, 0], apart[low, 1])
        least = min(least, float(distances.min(initial=np.inf)))
    return least


@given(own=paths(), other=paths())
def test_nothing_nearer_is_found_by_a_dense_search(own: TimedPath, other: TimedPath) -> None:
    met, searched_m = meeting(own, other, CYLINDER), dense(own, other)
    if met is None:
        assert searched_m >= CYLINDER.radius_m - 1e-9
    else:
        assert met.distance_m <= searched_m + 1e-9


@given(own=paths(), other=paths(), moved=st.tuples(_PLACE, _PLACE, _PLACE), by_s=st.floats(-5.0, 5.0))
def test_it_does_not_matter_where_the_room_is_or_when_it_begins(
    own: TimedPath, other: TimedPath, moved: tuple[float, float, float], by_s: float
) -> None:
    met = meeting(own, other, CYLINDER)
    there = [TimedPath(one.times_s + by_s, one.positions_w_m + np.array(moved)) for one in (own, other)]
    again = meeting(
        there[0], there[1], replace(CYLINDER, height_m=CYLINDER.height_m + 1e-6)
    )  # moved numbers are rounded
    if met is not None and met.distance_m < CYLINDER.radius_m - 1e-6:
        assert again is not None
        assert again.distance_m <= met.distance_m + 1e-6


def test_a_curve_is_told_in_few_knots_that_stay_within_two_centimetres() -> None:
    def circle(time_s: float) -> Array:
        return np.array([np.cos(0.5 * time_s), np.sin(0.5 * time_s), 1.0])

    told = sampled(circle, 60.0, 1000)
    times_s = np.linspace(0.0, 60.0, 5000)
    off_m = np.linalg.norm(told.at(times_s) - np.array([circle(time_s) for time_s in times_s]), axis=1)
    assert float(off_m.max()) < 0.025
    assert len(told.times_s) < 150
    assert len(sampled(circle, 60.0, 10).times_s) <= 10
    assert np.array_equal(sampled(circle, 0.0, 10).positions_w_m[0], [1.0, 0.0, 1.0])
