"""Tracking and fence: at their limits, and a jump in the data never stops the motors."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.estimation.state import Verdict
from companion.supervisor.faults import Event, Fault, Stage
from companion.supervisor.health_inputs import HealthInputs
from tests.supervisor.observing import (
    RULES,
    faults,
    healthy,
    on_ground,
    watched,
    with_seen,
    with_status,
    with_vehicle,
)

PLACE = np.array([0.5, -0.25, 1.0])


def off(cycle: int, error_m: float) -> HealthInputs:
    return replace(healthy(cycle), reference_w_m=PLACE + np.array([0.0, 0.6, -0.8]) * error_m)


def test_a_tracking_error_must_be_large_and_last() -> None:
    assert not any(watched([off(k, 0.4999) for k in range(100)]))
    events = watched([off(k, 0.5001) for k in range(100)])
    assert [bool(found) for found in events] == [k >= 32 for k in range(100)]
    assert set(events[32:]) == {(Event(Fault.TRACKING_ERROR, "0.50 m from the reference"),)}
    assert not any(watched([off(k, 0.25 if k == 20 else 0.75) for k in range(52)]))


def test_exactly_the_limits_are_allowed() -> None:
    flight = [replace(healthy(k), reference_w_m=PLACE + np.array([0.5, 0.0, 0.0])) for k in range(100)]
    assert not any(watched(flight))
    flight = [replace(healthy(k), reference_w_m=PLACE + np.array([1.0, 0.0, 0.0])) for k in range(100)]
    assert faults(watched(flight)[-1]) == [Fault.TRACKING_ERROR]


def test_further_still_is_lost_at_once() -> None:
    assert watched([off(0, 1.001)]) == [(Event(Fault.TRACKING_LOST, "1.00 m from the reference"),)]
    assert faults(watched([off(k, 1.001) for k in range(33)])[-1]) == [Fault.TRACKING_ERROR, Fault.TRACKING_LOST]


def grown(per_cycle_m: float, cycles: int = 100) -> list[HealthInputs]:
    return [off(k, 0.5001 + k * per_cycle_m) for k in range(cycles)]


def test_a_growing_error_is_lost_after_its_time() -> None:
    events = watched(grown(0.002))
    lost = [k for k, found in enumerate(events) if Fault.TRACKING_LOST in faults(found)]
    assert lost == list(range(64, 100))
    assert events[64] == (
        Event(Fault.TRACKING_ERROR, "0.63 m from the reference"),
        Event(Fault.TRACKING_LOST, "0.63 m from the reference, and growing"),
    )


@pytest.mark.parametrize(("over_m", "told"), [(0.0999, False), (0.1001, True)])
def test_it_must_grow_clearly(over_m: float, told: bool) -> None:
    """64 cycles are the time in which it is looked at."""
    events = watched(grown(over_m / 64.0, 200))
    assert any(Fault.TRACKING_LOST in faults(found) for found in events) is told


def test_growth_is_looked_at_over_its_time_only() -> None:
    """It grew, long ago."""
    flight = [off(k, 0.5001 + min(k, 40) * 0.004) for k in range(200)]
    lost = [k for k, found in enumerate(watched(flight)) if Fault.TRACKING_LOST in faults(found)]
    assert lost == list(range(64, 64 + 15))


@pytest.mark.parametrize(("back_m", "told"), [(0.0199, True), (0.0201, False)])
def test_noise_does_not_hide_growth_but_falling_back_does(back_m: float, told: bool) -> None:
    flight = [off(k, 0.55 + k * 0.002 - (back_m + 0.002 if k == 40 else 0.0)) for k in range(90)]
    found = [Fault.TRACKING_LOST in faults(events) for events in watched(flight)]
    assert any(found) is told


def test_growth_begins_where_the_error_is_large() -> None:
    """It passes the limit in cycle 10; a second crossing begins anew."""
    flight = [off(k, 0.48 + k * 0.002) for k in range(100)]
    lost = [k for k, found in enumerate(watched(flight)) if Fault.TRACKING_LOST in faults(found)]
    assert lost[0] == 11 + 64
    flight = [off(k, 0.3 if k == 60 else 0.51 + k * 0.002) for k in range(124)]
    assert not [1 for found in watched(flight) if Fault.TRACKING_LOST in faults(found)]


def test_nothing_is_tracked_on_the_ground_or_blind() -> None:
    far = off(0, 3.0)
    assert watched([replace(far, airborne=False)]) == [()]
    assert watched([replace(far, reference_w_m=None)]) == [()]
    assert watched([with_seen(far, vehicle=None)]) == [()]
    assert faults(watched([with_seen(far, age_s=0.1249)])[0]) == [Fault.MOCAP_LATE, Fault.TRACKING_LOST]
    assert faults(watched([with_seen(far, age_s=0.125)])[0]) == [Fault.MOCAP_LATE]
    assert watched([replace(far, reference_w_m=np.full(3, math.nan))]) == [()]


def at(cycle: int, x: float, y: float = 0.0, z: float = 1.0, v: tuple[float, float, float] = (0, 0, 0)) -> HealthInputs:
    now = with_vehicle(healthy(cycle, (x, y, z)), velocity_w_mps=np.array(v, dtype=float))
    return replace(now, reference_w_m=np.array((x, y, z)))


@pytest.mark.parametrize(
    ("now", "text"),
    [
        (at(0, 3.0, v=(1.0, 0.0, 0.0)), None),
        (at(0, 4.0), None),
        (at(0, 3.5, v=(0.71, 0.0, 0.0)), None),
        (at(0, 3.5, v=(0.75, 0.0, 0.0)), "0.50 m inside the fence and too fast to stop there"),
        (at(0, 3.5, v=(-3.0, 0.0, 0.0)), None),
        (at(0, 0.0, -3.5, v=(0.0, -0.75, 0.0)), "0.50 m inside the fence and too fast to stop there"),
        (at(0, 0.0, 0.0, 2.75, v=(0.0, 0.0, 1.0)), "0.25 m inside the fence and too fast to stop there"),
        (at(0, 0.0, 0.0, 0.1, v=(0.0, 0.0, -3.0)), None),
    ],
)
def test_too_fast_to_stop_inside_is_near(now: HealthInputs, text: str | None) -> None:
    assert watched([now]) == [() if text is None else (Event(Fault.FENCE_NEAR, text),)]


def test_a_stop_at_the_fence_itself_is_inside() -> None:
    """v t + v^2 / 2a = 0.5 + 0.25 m."""
    assert watched([at(0, 3.25, v=(1.0, 0.0, 0.0))]) == [()]


def test_outside_is_outside_however_it_flies() -> None:
    for v in ((0, 0, 0), (-3.0, 0, 0), (3.0, 0, 0)):
        assert watched([at(0, 4.0625, v=v)]) == [(Event(Fault.FENCE_LEFT, "0.06 m outside the fence"),)]


def way_out(end_m: float = 6.0) -> list[HealthInputs]:
    """Return a flight from inside out over the fence, a frame every cycle."""
    return [at(k, min(3.5 + k * 0.125, end_m)) for k in range(30)]


def beyond(events: list[tuple[Event, ...]]) -> list[int]:
    return [k for k, found in enumerate(events) if Fault.ROOM_LEFT in faults(found)]


def test_half_a_metre_outside_the_room_is_left() -> None:
    events = watched(way_out())
    assert beyond(events) == list(range(9, 30))
    assert events[8] == (Event(Fault.FENCE_LEFT, "0.50 m outside the fence"),)
    assert events[9] == (
        Event(Fault.FENCE_LEFT, "0.62 m outside the fence"),
        Event(Fault.ROOM_LEFT, "0.62 m outside the fence with turning motors"),
    )


def handed_over(now: HealthInputs) -> HealthInputs:
    now = replace(now, stage=Stage.HANDED_OVER, commanded=False, streaming=False, airborne=False)
    return replace(now, reference_w_m=None)


def test_it_is_left_by_the_autopilot_too() -> None:
    assert beyond(watched([handed_over(now) for now in way_out()])) == list(range(9, 30))


def test_who_does_not_turn_or_is_not_seen_cannot_leave() -> None:
    out = way_out()
    assert not any(watched([on_ground(now) for now in out]))
    none = watched([*out[:3], *(with_seen(now, age_s=0.25) for now in out[3:])])
    assert not [1 for events in none[3:] if {Fault.FENCE_LEFT, Fault.FENCE_NEAR} & set(faults(events))]
    assert beyond(watched([*out[:3], *(with_seen(now, age_s=0.2499) for now in out[3:])])) == list(range(9, 30))
    assert not any(watched([*out[:3], *(with_seen(now, vehicle=None) for now in out[3:])]))


def test_a_jump_in_the_data_is_no_way_out() -> None:
    """Ten frames agree on a place outside: the filter begins anew there."""
    there = at(10, 6.0)
    flight = [*(at(k, 0.0) for k in range(10)), with_seen(there, verdict=Verdict.STARTED), at(11, 6.0)]
    events = watched([*flight, *(handed_over(at(k, 6.0)) for k in range(12, 20))])
    assert Fault.FENCE_LEFT in faults(events[-1])
    assert beyond(events) == []


def test_after_a_jump_in_the_air_no_way_out_is_believed() -> None:
    """Inside once more, and out from there: whose pose it is nobody knows."""
    back = with_seen(handed_over(at(10, 0.0)), verdict=Verdict.STARTED)
    flight = [*(at(k, 0.0) for k in range(10)), back]
    flight += [handed_over(at(11 + k, 3.5 + 0.125 * k)) for k in range(20)]
    assert beyond(watched(flight)) == []


def test_the_next_flight_is_believed_again() -> None:
    jump = with_seen(at(10, 0.0), verdict=Verdict.STARTED)
    flight = [*(at(k, 0.0) for k in range(10)), jump, on_ground(at(11, 0.0))]
    flight += [at(12 + k, 3.5 + 0.125 * k) for k in range(20)]
    assert beyond(watched(flight)) == list(range(21, 32))


def test_the_first_frame_of_all_before_arming_raises_no_doubt() -> None:
    first = on_ground(with_seen(at(0, 3.5), verdict=Verdict.STARTED))
    same_frame = replace(at(0, 3.5), mocap=first.mocap)
    assert beyond(watched([first, same_frame, *(at(k, 3.5 + k * 0.125) for k in range(1, 30))])) == list(range(10, 31))


def test_who_was_never_inside_is_not_stopped() -> None:
    flight = [on_ground(at(0, 6.0)), *(at(k, 6.0) for k in range(1, 5)), at(5, 4.0), at(6, 6.0)]
    assert beyond(watched([*flight[:5], at(5, 4.0625), at(6, 6.0)])) == []
    assert beyond(watched(flight)) == [6]
    assert beyond(watched([*flight, on_ground(at(7, 6.0)), at(8, 6.0)])) == [6]


def test_inside_unseen_does_not_count() -> None:
    assert beyond(watched([with_seen(at(0, 0.0), age_s=0.25), at(1, 6.0)])) == []
    assert beyond(watched([with_seen(at(0, 0.0), age_s=0.2499), at(1, 6.0)])) == [1]


def test_a_place_that_is_no_number_is_nowhere() -> None:
    assert not any(watched([with_status(at(0, math.nan, math.nan, math.nan), armed=True)], RULES))
