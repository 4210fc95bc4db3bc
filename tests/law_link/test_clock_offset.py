"""Offset of two clocks from messages that go round."""

from math import isnan

import numpy as np
import pytest

from companion.law_link.clock_offset import HALF_WINDOW_S, ClockOffset, RoundTrip


def trip(sent_s: float, offset_s: float, up_s: float = 0.002, down_s: float = 0.002, held_s: float = 0.01) -> RoundTrip:
    """Return an exchange; the vehicle's clock less the ground's is `offset_s`."""
    received_s = sent_s + up_s + offset_s
    return RoundTrip(
        ground_sent_s=sent_s,
        vehicle_received_s=received_s,
        vehicle_sent_s=received_s + held_s,
        ground_received_s=sent_s + up_s + held_s + down_s,
    )


def test_nothing_is_known_before_the_first_exchange() -> None:
    assert isnan(ClockOffset().offset_s)
    assert isnan(ClockOffset().round_trip_s)


def test_the_quickest_exchange_counts() -> None:
    clock = ClockOffset()
    for k, up_s in enumerate((0.02, 0.002, 0.03)):
        clock = clock.after(trip(0.1 * k, 50.0, up_s=up_s))
    assert clock.round_trip_s == pytest.approx(0.004)
    assert clock.offset_s == pytest.approx(50.0)


def test_drift_is_followed_by_dropping_what_is_old() -> None:
    clock, s = ClockOffset(), 0.0
    while s < 10.0 * HALF_WINDOW_S:
        s += 0.05
        clock = clock.after(trip(s, 50.0 + 1e-4 * s))
    assert clock.offset_s == pytest.approx(50.0 + 1e-4 * s, abs=1e-4 * 2.0 * HALF_WINDOW_S)


@pytest.mark.parametrize("jump_s", [-100.0, -0.05, 0.05, 100.0])
def test_a_jump_of_a_clock_is_noticed(jump_s: float) -> None:
    clock = ClockOffset().after(trip(0.0, 50.0)).after(trip(1.0, 50.0))
    clock = clock.after(trip(2.0, 50.0 - jump_s))
    assert clock.offset_s == pytest.approx(50.0 - jump_s)


def test_an_exchange_that_ends_before_it_begins_makes_the_clock_unknown() -> None:
    clock = ClockOffset().after(trip(0.0, 50.0)).after(trip(1.0, 50.0, down_s=-0.5))
    assert isnan(clock.offset_s)


def test_a_network_that_delays_one_way_is_no_jump() -> None:
    clock, rng = ClockOffset(), np.random.default_rng(1)
    for k in range(200):
        up_s, down_s = rng.uniform(0.001, 0.2, 2)
        clock = clock.after(trip(0.01 * k, 50.0, up_s=up_s, down_s=down_s))
        assert abs(clock.offset_s - 50.0) <= 0.5 * clock.round_trip_s + 1e-9
    assert clock.round_trip_s < 0.05
