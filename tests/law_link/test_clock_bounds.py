"""The offset of the clocks on any network: never more wrong than half of the quickest round trip."""

import math

from hypothesis import given
from hypothesis import strategies as st

from companion.law_link.clock_offset import ClockOffset, RoundTrip

WAYS_S = st.floats(0.0, 0.2)
OFFSETS_S = st.floats(-1e5, 1e5)


def exchange(ground_s: float, offset_s: float, up_s: float, held_s: float, down_s: float) -> RoundTrip:
    """Return an exchange that begins at `ground_s`, with these times on the way and on the vehicle."""
    arrives_s = ground_s + offset_s + up_s
    return RoundTrip(
        ground_sent_s=ground_s,
        vehicle_received_s=arrives_s,
        vehicle_sent_s=arrives_s + held_s,
        ground_received_s=ground_s + up_s + held_s + down_s,
    )


@given(OFFSETS_S, st.lists(st.tuples(WAYS_S, WAYS_S, WAYS_S), min_size=1, max_size=60))
def test_the_offset_is_wrong_by_at_most_half_of_the_quickest_round_trip(
    offset_s: float, ways: list[tuple[float, float, float]]
) -> None:
    clock = ClockOffset()
    for number, (up_s, held_s, down_s) in enumerate(ways):
        clock = clock.after(exchange(0.05 * number, offset_s, up_s, held_s, down_s))
    assert abs(clock.offset_s - offset_s) <= 0.5 * clock.round_trip_s + 1e-6
    assert clock.round_trip_s <= min(up_s + down_s for up_s, _, down_s in ways[-60:]) + 1e-6


@given(OFFSETS_S, WAYS_S, WAYS_S)
def test_a_network_that_is_as_slow_up_as_down_gives_the_offset_exactly(
    offset_s: float, way_s: float, held_s: float
) -> None:
    clock = ClockOffset().after(exchange(3.0, offset_s, way_s, held_s, way_s))
    assert math.isclose(clock.offset_s, offset_s, abs_tol=1e-6)
    assert math.isclose(clock.round_trip_s, 2.0 * way_s, abs_tol=1e-6)
