"""Tests of the goals sent to a joint: no jumps, stops in the direction of motion, no change of a held goal."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.adapters.dynamixel.joint import (
    Joint,
    braking_velocity,
    goal_velocity,
    joints_of,
    next_goal,
    stopping_point,
)
from companion.adapters.dynamixel.registers import Answer
from companion.config.arms_config import ArmsConfig

CYCLE_S = 0.01
FASTEST_RADPS, ACCEL_RADPS2 = 1.2 * 3.0, 20.0
"""Limits of a shoulder's goals."""
BEYOND_RAD = 1.61
"""A shoulder's limit is 1.57 rad."""

angles = st.floats(-3.0, 3.0)
orders = st.lists(st.floats(-1.5, 1.5), max_size=12)
"""One after the other, at any of which the joint may be told to stop."""
cycle_times = st.floats(0.001, 0.05)


def shoulder(held_rad: float = 0.0) -> Joint:
    """Return a shoulder joint that is held at `held_rad`."""
    joint = joints_of(ArmsConfig())[0]
    joint.begin_driving(held_rad)
    return joint


def streamed(joint: Joint, *goals_rad: float) -> Joint:
    """Send these goals, one a cycle, and return the joint."""
    for goal_rad in goals_rad:
        joint.order(goal_rad)
        joint.advance(CYCLE_S)
    return joint


def moving(velocity_radps: float, to_rad: float) -> Joint:
    """Return a shoulder whose goals move steadily, the last one to this angle."""
    steps = [to_rad - velocity_radps * CYCLE_S * left for left in range(20, -1, -1)]
    return streamed(shoulder(steps[0]), *steps)


def brought_to_rest(joint: Joint, dt_s: float = CYCLE_S) -> list[float]:
    """Return all goals sent after a stop, preceded by the one before it."""
    joint.stop()
    return [joint.sent_rad, *(joint.advance(dt_s) for _ in range(200))]


@given(angles, angles, st.floats(0.01, 10.0), st.floats(0.0, 0.1))
def test_goals_never_jump_and_never_overshoot(sent: float, wanted: float, fastest: float, dt_s: float) -> None:
    goal = next_goal(sent, wanted, fastest, dt_s)
    assert abs(goal - sent) <= fastest * dt_s + 1e-12
    assert min(sent, wanted) - 1e-12 <= goal <= max(sent, wanted) + 1e-12


@given(angles, angles, st.floats(0.5, 10.0))
def test_goals_arrive(sent: float, wanted: float, fastest: float) -> None:
    for _ in range(1 + math.ceil(abs(wanted - sent) / (fastest * 0.01))):
        sent = next_goal(sent, wanted, fastest, 0.01)
    assert sent == pytest.approx(wanted, abs=1e-9)


def test_a_clock_that_goes_back_moves_nothing() -> None:
    assert next_goal(0.3, 1.0, 3.0, -0.01) == 0.3


def test_goals_stop_where_braking_ends() -> None:
    assert stopping_point(0.5, 3.0, 20.0) == pytest.approx(0.5 + 9.0 / 40.0)
    assert stopping_point(0.5, -3.0, 20.0) == pytest.approx(0.5 - 9.0 / 40.0)
    assert stopping_point(0.5, 0.0, 20.0) == 0.5


@given(st.floats(0.01, 5.0), st.floats(1.0, 30.0))
def test_the_speed_left_for_braking_is_what_the_way_to_the_stopping_point_allows(velocity: float, accel: float) -> None:
    assert braking_velocity(stopping_point(0.0, velocity, accel), accel) == pytest.approx(velocity)


@given(st.floats(-4.0, 4.0), st.lists(cycle_times, min_size=1, max_size=5))
def test_steady_goals_have_their_speed_whatever_the_cycles(velocity: float, cycles: list[float]) -> None:
    steps = [(dt_s, velocity * dt_s) for dt_s in cycles]
    assert goal_velocity(steps) == pytest.approx(velocity)


@pytest.mark.parametrize("steps_rad", [(0.01, 0.01, 0.01, 0.02, 0.0), (0.01, 0.01, 0.01, 0.0, 0.02)])
def test_a_cycle_without_a_new_goal_and_one_with_two_are_no_change_of_speed(steps_rad: tuple[float, ...]) -> None:
    assert goal_velocity([(CYCLE_S, step_rad) for step_rad in steps_rad]) == pytest.approx(1.0)


def test_goals_that_stand_or_have_just_turned_have_no_speed() -> None:
    assert goal_velocity([]) == 0.0
    assert goal_velocity([(0.0, 0.0)]) == 0.0
    assert goal_velocity([(CYCLE_S, 0.02), (CYCLE_S, 0.02), (CYCLE_S, 0.0), (CYCLE_S, 0.0)]) == 0.0
    assert goal_velocity([(CYCLE_S, 0.02), (CYCLE_S, 0.02), (CYCLE_S, -0.01), (CYCLE_S, -0.01)]) == 0.0


def test_a_moving_joint_stops_beyond_its_goal_by_what_braking_takes_however_old_its_reading() -> None:
    joint = moving(2.0, to_rad=0.5)
    state = (0).to_bytes(6, "little") + (round((math.pi + 0.1) * 4096 / math.tau)).to_bytes(4, "little") + bytes(11)
    joint.hear(Answer(126, state, 0), now_s=-0.19)
    assert joint.reading is not None
    assert joint.reading.position_rad == pytest.approx(0.1, abs=0.001)
    joint.stop()
    assert joint.wanted_rad == pytest.approx(0.5 + 2.0**2 / 40.0)


def test_goals_that_move_at_one_radian_a_second_come_to_rest_by_steps_that_shrink() -> None:
    goals = brought_to_rest(moving(-1.0, to_rad=0.3))
    steps = [goal - before for before, goal in pairwise(goals)]
    assert goals[-1] == pytest.approx(0.3 - 1.0 / 40.0)
    assert steps[0] == pytest.approx(-0.01)
    assert all(before <= later <= 0.0 for before, later in pairwise(steps))


def test_a_joint_at_rest_keeps_its_goal_when_it_is_told_to_stop() -> None:
    joint = streamed(shoulder(), *[0.123] * 12)
    assert set(brought_to_rest(joint)) == {0.123}


@given(orders, cycle_times)
def test_a_stop_never_reverses_never_jumps_and_ends_no_farther_than_braking_takes(
    goals_rad: list[float], dt_s: float
) -> None:
    joint = shoulder()
    before_rad = [0.0]
    for goal_rad in goals_rad:
        joint.order(goal_rad)
        before_rad.append(joint.advance(dt_s))
    last_step = before_rad[-1] - before_rad[-2] if goals_rad else 0.0
    goals = brought_to_rest(joint, dt_s)
    further = goals[-1] - goals[0]
    assert last_step * further >= 0.0
    assert abs(further) <= FASTEST_RADPS**2 / (2.0 * ACCEL_RADPS2) + 1e-9
    sign = math.copysign(1.0, further)
    assert all(0.0 <= sign * (goal - before) <= FASTEST_RADPS * dt_s + 1e-9 for before, goal in pairwise(goals))
    assert joint.limit.min_rad <= goals[-1] <= joint.limit.max_rad


def test_an_order_after_a_stop_is_followed_at_full_speed_again() -> None:
    joint = moving(1.0, to_rad=0.3)
    brought_to_rest(joint)
    joint.order(1.0)
    assert joint.advance(CYCLE_S) == pytest.approx(0.325 + FASTEST_RADPS * CYCLE_S)


@pytest.mark.parametrize("goal_rad", [BEYOND_RAD, 1.7, 100.0])
def test_a_joint_held_beyond_its_limit_stays_there_until_a_goal_leads_inwards(goal_rad: float) -> None:
    joint = streamed(shoulder(BEYOND_RAD), *[goal_rad] * 5)
    assert joint.sent_rad == BEYOND_RAD
    assert set(brought_to_rest(joint)) == {BEYOND_RAD}


def test_a_joint_held_beyond_its_limit_is_led_in_no_faster_than_it_may_move_and_not_out_again() -> None:
    joint = shoulder(BEYOND_RAD)
    streamed(joint, 1.0)
    assert joint.sent_rad == pytest.approx(BEYOND_RAD - FASTEST_RADPS * CYCLE_S)
    streamed(joint, *[1.0] * 30, *[BEYOND_RAD] * 30)
    assert joint.sent_rad == pytest.approx(joint.limit.max_rad)


@given(st.floats(1.5, 1.65), st.lists(angles, min_size=1, max_size=10))
def test_no_goal_leads_further_out_than_the_joint_is_held(held_rad: float, goals_rad: list[float]) -> None:
    joint = shoulder(held_rad)
    sent = [held_rad, *(streamed(joint, goal_rad).sent_rad for goal_rad in goals_rad)]
    assert all(-1.57 <= goal <= max(1.57, before) for before, goal in pairwise(sent))
