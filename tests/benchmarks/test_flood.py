"""A flight that many pages look at: the count of dropped frames, and a small flood for real."""

import pytest

from benchmarks.flood import dropped_of, measure_flood

SENT_S = [0.01 * number for number in range(10)]


def used(*numbers: int) -> list[tuple[int, float]]:
    return [(number, SENT_S[number] + 0.001) for number in numbers]


def test_a_frame_that_no_tick_used_is_dropped() -> None:
    assert dropped_of(used(0, 1, 2, 3), SENT_S, 0.005) == 0
    assert dropped_of(used(0, 1, 3, 6), SENT_S, 0.005) == 3
    assert dropped_of([], SENT_S, 0.005) == 0


def test_a_frame_that_came_together_with_the_next_is_not_missed() -> None:
    sent_s = [0.0, 0.01, 0.0299, 0.03, 0.04]
    arrived = [(0, 0.001), (1, 0.011), (3, 0.031), (4, 0.041)]
    assert dropped_of(arrived, sent_s, 0.005) == 0


@pytest.mark.realtime
async def test_fifty_pages_go_on_hearing_states_and_the_flight_goes_on() -> None:
    cost = await measure_flood(100.0, 50, [2.0], lambda _: None)
    assert cost.closed == 0
    assert cost.states_per_s > 1.0, "of ten that are sent: the pages' server goes after all else on a busy computer"
    assert cost.frames - cost.dropped > 150, "the flight goes on; how many frames are lost is measured by make bench"
