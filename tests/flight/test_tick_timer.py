"""The control rate, kept by arithmetic alone: no clock is read here."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.flight.tick_timer import TickTimer

PERIOD_S = 0.01


def test_without_frames_the_rate_is_exact() -> None:
    timer = TickTimer(PERIOD_S, 1.0)
    for n in range(1000):
        assert timer.deadline_s == pytest.approx(1.0 + n * PERIOD_S + 0.004, abs=1e-9)
        assert timer.begin(timer.deadline_s + 0.001, None) == pytest.approx(0.001)


def test_lateness_is_counted_from_the_frame_that_started_the_cycle() -> None:
    timer = TickTimer(PERIOD_S, 1.0)
    assert timer.begin(1.0007, 1.0005) == pytest.approx(0.0002)


def test_a_frame_that_comes_after_the_deadline_makes_no_late_cycle_punctual() -> None:
    timer = TickTimer(PERIOD_S, 1.0)
    assert timer.begin(1.0500, 1.0495) == pytest.approx(0.046), "the deadline was at 1.004"


def test_a_loop_whose_cycles_take_too_long_is_late_though_frames_flow() -> None:
    timer, now_s, late = TickTimer(PERIOD_S, 1.0), 1.0, []
    for _ in range(50):
        late.append(timer.begin(now_s, now_s - 0.002))
        now_s = max(now_s + 0.04, timer.due_s)
    assert late[0] == pytest.approx(0.002)
    assert min(late[2:]) > 0.03


@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.0331])
def test_slow_frames_make_no_late_cycles(period_s: float) -> None:
    """Wait as the loop does: for a frame that is not early, until the deadline."""
    timer, frames = TickTimer(PERIOD_S, 1.0), [1.0003 + k * period_s for k in range(100)]
    while frames:
        arrived_s = next((at_s for at_s in frames if not timer.frame_is_early(at_s)), frames[-1])
        now_s, frame_s = (arrived_s, arrived_s) if arrived_s <= timer.deadline_s else (timer.deadline_s, None)
        assert timer.begin(now_s, frame_s) == pytest.approx(0.0, abs=1e-9)
        frames = [at_s for at_s in frames if at_s > now_s]


@given(offset_s=st.floats(-0.0049, 0.0039), drift=st.floats(-2e-4, 2e-4))
def test_the_due_time_is_drawn_to_the_frames_and_follows_their_drift(offset_s: float, drift: float) -> None:
    timer = TickTimer(PERIOD_S, 1.0)
    arrived_s = 1.0 + offset_s
    for _ in range(400):
        assert not timer.frame_is_early(arrived_s)
        timer.begin(arrived_s, arrived_s)
        arrived_s += PERIOD_S * (1.0 + drift)
    # an integrator with gain 0.1 lags a ramp by ramp / gain
    assert timer.due_s - arrived_s == pytest.approx(-PERIOD_S * drift / 0.1, abs=1e-7)


def test_one_wild_frame_moves_the_due_time_by_a_twentieth_of_a_period_at_most() -> None:
    for wild_s in (-5.0, 5.0):
        timer = TickTimer(PERIOD_S, 1.0)
        timer.begin(1.0, 1.0 + wild_s)
        assert abs(timer.due_s - 1.01) <= 0.05 * PERIOD_S + 1e-12


@pytest.mark.parametrize(("arrived_s", "early"), [(0.9949, True), (0.9951, False), (1.0, False), (1.003, False)])
def test_a_frame_more_than_half_a_period_early_belongs_to_no_cycle(arrived_s: float, early: bool) -> None:
    assert TickTimer(PERIOD_S, 1.0).frame_is_early(arrived_s) == early


@pytest.mark.parametrize("offset_s", [-0.004, -0.0001, 0.0001, 0.002])
def test_a_source_at_twice_the_rate_starts_every_other_cycle(offset_s: float) -> None:
    timer = TickTimer(PERIOD_S, 1.0)
    begun = []
    for n in range(200):
        arrived_s = 1.0 + offset_s + 0.005 * n
        if not timer.frame_is_early(arrived_s):
            timer.begin(arrived_s, arrived_s)
            begun.append(n)
    assert len(begun) in (100, 101), "a first frame half a period off may start one cycle more"
    assert all(later - sooner == 2 for sooner, later in pairwise(begun[2:]))


def test_a_stopped_loop_skips_whole_periods() -> None:
    timer = TickTimer(PERIOD_S, 1.0)
    timer.begin(1.0553, None)
    assert timer.due_s == pytest.approx(1.05), "due at 1.01, 1.02, 1.03 and 1.04 without a cycle"
    timer.begin(1.0554, None)
    assert timer.due_s == pytest.approx(1.06)
