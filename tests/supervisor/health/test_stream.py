"""Rate, delay, order and clock of the frames: at their limits, and what must not be taken for what."""

import math
from collections.abc import Iterable
from dataclasses import replace

import pytest

from companion.estimation.state import Verdict
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NOT_HELD
from companion.supervisor.health.stream import StreamHealth, check_stream
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules
from tests.supervisor.observing import (
    CYCLE_S,
    RULES,
    faults,
    handed_over,
    healthy,
    on_ground,
    standing,
    text_of,
    watched,
    with_seen,
    with_status,
)

SECOND = round(1.0 / CYCLE_S)


def share(cycle: int, of_a_second: int) -> bool:
    """True so often in any second, evenly."""
    return cycle * of_a_second // SECOND != (cycle - 1) * of_a_second // SECOND


def seldom_usable(cycles: Iterable[int], of_a_second: int) -> list[HealthInputs]:
    lost = Verdict.OUTLIER
    return [healthy(k) if share(k, of_a_second) else with_seen(healthy(k), verdict=lost) for k in cycles]


def when(events: list[tuple[Event, ...]], fault: Fault) -> list[int]:
    """Cycles in which a fault is there."""
    return [cycle for cycle, found in enumerate(events) if fault in faults(found)]


def test_fifty_usable_frames_in_a_second_are_enough() -> None:
    assert not any(watched(seldom_usable(range(3 * SECOND), 50)))


def test_fewer_are_not_once_a_whole_second_was_seen() -> None:
    events = watched(seldom_usable(range(3, 2 * SECOND), 49))
    first = 3 - 3  # the third cycle brings the first usable frame
    assert when(events, Fault.MOCAP_SLOW) == list(range(first + SECOND, 2 * SECOND - 3))
    assert set(events[-1]) == {Event(Fault.MOCAP_SLOW, "49 usable frames in a second, fewer than 50")}


def seen_by_a_loop_that_is_late(late_s: float, of_a_second: int) -> list[HealthInputs]:
    """Cycles with frames, that many of a second, as all that is left of it; each begins so late."""
    flight = [healthy(k) for k in range(SECOND)]
    for k in range(SECOND, 3 * SECOND):
        if share(k, of_a_second):
            flight.append(replace(healthy(k), late_s=late_s))
    return flight


def names(flight: list[HealthInputs], rules: SafetyRules = RULES) -> set[Fault]:
    return {fault for found in watched(flight, rules) for fault in faults(found)}


def test_frames_that_a_late_loop_passed_over_are_not_motion_captures_fault() -> None:
    events = watched(seen_by_a_loop_that_is_late(1.0 / 64.0, 49))
    assert {fault for found in events for fault in faults(found)} == {Fault.LOOP_LATE}
    text = "49 usable frames in a second, fewer than 50: cycles began 0.77 s late in it"
    assert set(events[-1]) == {Event(Fault.LOOP_LATE, text)}


def test_a_slow_stream_stays_one_whatever_the_loop_does_now_and_then() -> None:
    slow = seldom_usable(range(3 * SECOND), 40)
    assert names(slow) == {Fault.MOCAP_SLOW}
    slow = [replace(now, late_s=0.1875 if k % SECOND == 5 else 0.0) for k, now in enumerate(slow)]
    assert names(slow) == {Fault.MOCAP_SLOW}, "40 frames in 0.81 s are too few"


@pytest.mark.parametrize(("late_s", "blamed"), [(0.0312, Fault.MOCAP_SLOW), (0.03125, Fault.LOOP_LATE)])
def test_enough_frames_in_the_time_it_was_awake_are_enough(late_s: float, blamed: Fault) -> None:
    """60 frames a second, where 64 should be: 1/16 of the second explains it."""
    flight = seldom_usable(range(3 * SECOND), 60)
    twice = [replace(now, late_s=late_s if k % SECOND in {5, 6} else 0.0) for k, now in enumerate(flight)]
    assert names(twice, replace(RULES, slow_hz=64.0)) == {blamed}


@pytest.mark.parametrize("late_s", [0.01, math.nan, math.inf, -1.0])
def test_a_little_late_passes_over_no_frame(late_s: float) -> None:
    assert names([replace(now, late_s=late_s) for now in seldom_usable(range(3 * SECOND), 49)]) == {Fault.MOCAP_SLOW}


def test_late_cycles_are_forgotten_after_a_second() -> None:
    late = [replace(healthy(k), late_s=1.0 / 64.0) for k in range(SECOND)]
    assert names([*late, *seldom_usable(range(SECOND, 4 * SECOND), 49)]) >= {Fault.MOCAP_SLOW}


def test_a_start_is_usable_too() -> None:
    flight = [standing(with_seen(healthy(k), verdict=Verdict.STARTED)) for k in range(2 * SECOND)]
    assert not any(watched(flight))


def test_a_second_without_new_frames_counts() -> None:
    """Every third cycle brings one."""
    flight = [with_seen(healthy(k), frame=k // 3, stamp_s=(k // 3) * 3 * CYCLE_S) for k in range(2 * SECOND)]
    events = watched([with_seen(now, received_s=now.mocap.stamp_s + 900.0) for now in flight])
    assert when(events, Fault.MOCAP_SLOW) == list(range(SECOND, 2 * SECOND))
    assert events[-1][0].text == "43 usable frames in a second, fewer than 50"


def test_after_a_silence_the_second_begins_anew() -> None:
    flight = [healthy(k) for k in range(SECOND)]
    gap = [with_seen(healthy(SECOND - 1), age_s=0.26)] * 1
    silent = [replace(gap[0], time_s=healthy(SECOND + k).time_s) for k in range(100)]
    back = [healthy(k) for k in range(SECOND + 100, 3 * SECOND)]
    events = watched([*flight, *silent, *back])
    assert not when(events, Fault.MOCAP_SLOW)
    slow = seldom_usable(range(SECOND + 100, 3 * SECOND), 30)
    began = next(k for k in range(SECOND + 100, 3 * SECOND) if share(k, 30))
    assert when(watched([*flight, *silent, *slow]), Fault.MOCAP_SLOW)[0] == began + SECOND


@pytest.mark.parametrize(("age_s", "slow"), [(0.25, True), (0.2501, False)])
def test_frames_that_come_silently_late_are_no_stream(age_s: float, slow: bool) -> None:
    flight = [with_seen(now, age_s=age_s) for now in seldom_usable(range(2 * SECOND), 20)]
    events = watched(flight)
    assert bool(when(events, Fault.MOCAP_SLOW)) is slow
    assert bool(when(events, Fault.MOCAP_DELAYED)) is slow


def test_a_stream_is_watched_before_it_is_told_of() -> None:
    flight = [on_ground(now) for now in seldom_usable(range(2 * SECOND), 20)]
    events = watched([*flight, *seldom_usable([2 * SECOND], 20)])
    assert when(events, Fault.MOCAP_SLOW) == [2 * SECOND]


def stale(cycle: int) -> HealthInputs:
    return with_seen(healthy(cycle), verdict=Verdict.STALE)


def test_a_quarter_of_the_frames_may_be_stale() -> None:
    assert not any(watched([stale(k) if share(k, 32) else healthy(k) for k in range(2 * SECOND)]))


def test_more_than_a_quarter_may_not() -> None:
    events = watched([stale(k) if share(k, 33) else healthy(k) for k in range(2 * SECOND)])
    assert when(events, Fault.MOCAP_OUT_OF_ORDER) == list(range(SECOND + 1, 2 * SECOND))
    assert events[-1] == (
        Event(Fault.MOCAP_OUT_OF_ORDER, "33 of 128 frames in a second are older than one already used"),
    )


def test_stale_frames_are_forgotten_after_a_second() -> None:
    flight = [stale(k) if 64 <= k < 102 else healthy(k) for k in range(4 * SECOND)]
    events = when(watched(flight), Fault.MOCAP_OUT_OF_ORDER)
    assert events == list(range(SECOND, 64 + SECOND + 5))


def with_dropped(flight: list[HealthInputs], before: Iterable[int]) -> list[HealthInputs]:
    """The adapter dropped a frame before each of these cycles' frames, which the count says from then on."""
    dropped = sorted(before)
    return [with_seen(now, late=5 + sum(k <= cycle for k in dropped)) for cycle, now in enumerate(flight)]


def test_frames_the_adapter_dropped_count_too() -> None:
    flight = [healthy(k) for k in range(3 * SECOND)]
    few = [k for k in range(1, len(flight)) if share(k, 42)]  # 42 of 128 + 42
    assert not any(watched(with_dropped(flight, few)))
    many = [k for k in range(1, len(flight)) if share(k, 43)]
    events = watched(with_dropped(flight, many))
    assert when(events, Fault.MOCAP_OUT_OF_ORDER) == list(range(SECOND, 3 * SECOND))
    assert events[-1] == (
        Event(Fault.MOCAP_OUT_OF_ORDER, "43 of 171 frames in a second are older than one already used"),
    )


def test_dropped_frames_are_counted_as_many_as_they_are_and_forgotten_after_a_second() -> None:
    flight = [healthy(k) for k in range(4 * SECOND)]
    burst = with_dropped(flight, [2 * SECOND] * 43)
    assert when(watched(burst), Fault.MOCAP_OUT_OF_ORDER) == list(range(2 * SECOND, 3 * SECOND))
    assert not any(watched(with_dropped(flight, [2 * SECOND] * 42)))


def test_dropped_and_stale_ones_are_counted_together() -> None:
    flight = [stale(k) if k % 8 == 0 else healthy(k) for k in range(1, 2 * SECOND)]
    assert not any(watched(flight))
    both = with_dropped(flight, [k for k in range(len(flight)) if k % 4 == 0])
    events = watched(both)
    assert text_of(events[-1], Fault.MOCAP_OUT_OF_ORDER).startswith("48 of 160 frames")


def test_a_new_connection_counts_its_dropped_frames_anew() -> None:
    flight = [with_seen(healthy(k), late=200 if k < SECOND else 0) for k in range(3 * SECOND)]
    flight[0] = with_seen(flight[0], late=0)
    events = watched(flight)
    assert not when(events, Fault.MOCAP_OUT_OF_ORDER)[1:], events
    assert not any(events[SECOND + 1 :])


def late(cycle: int, age_s: float) -> HealthInputs:
    return with_seen(healthy(cycle), age_s=age_s)


def test_a_lasting_age_is_a_delay_after_half_a_second() -> None:
    events = watched([late(k, 0.0626) for k in range(SECOND)])
    assert when(events, Fault.MOCAP_DELAYED) == list(range(SECOND // 2, SECOND))
    text = "poses come 0.063 s late for 0.5 s, more than 0.0625 s"
    assert text_of(events[-1], Fault.MOCAP_DELAYED) == text
    assert not when(watched([late(k, 0.0625) for k in range(SECOND)]), Fault.MOCAP_DELAYED)


def test_the_median_decides() -> None:
    half = [late(k, 0.25 if k % 2 else 0.0) for k in range(2 * SECOND)]
    assert not when(watched(half), Fault.MOCAP_DELAYED)
    more = [late(k, (0.0, 0.125, 0.25)[k % 3]) for k in range(2 * SECOND)]
    found = watched(more)
    assert when(found, Fault.MOCAP_DELAYED) == list(range(SECOND // 2, 2 * SECOND))
    assert text_of(found[-1], Fault.MOCAP_DELAYED).startswith("poses come 0.125 s late")


def test_the_middle_one_of_an_odd_number_is_told() -> None:
    """Half a second holds 64 frames; the last is of no use."""
    flight = [late(k, 0.0626 + (k % 64) * 0.0025) for k in range(SECOND)]
    flight[-1] = with_seen(flight[-1], verdict=Verdict.OUTLIER)
    ages_s = sorted(now.mocap.age_s for now in flight[-64:-1])
    told = text_of(watched(flight)[-1], Fault.MOCAP_DELAYED)
    assert told.startswith(f"poses come {ages_s[31]:.3f} s late")


@pytest.mark.parametrize("count", [33, 40, 64])
def test_the_median_is_told(count: int) -> None:
    """Tell the lower one of the two in the middle of 64 delays, `count` of which are above the limit."""
    ages = [0.0] * (64 - count) + [0.0626 + i * (0.25 - 0.0626) / 64 for i in range(count)]
    if count == 64:
        ages = [0.25] * 64
    flight = [healthy(k) for k in range(64)] + [late(64 + k, age_s) for k, age_s in enumerate(ages)]
    text = text_of(watched(flight)[127], Fault.MOCAP_DELAYED)
    expected = sorted(ages)[31]
    assert text.startswith(f"poses come {expected:.3f} s late")


def test_the_age_between_frames_is_no_delay() -> None:
    """Sixteen frames a second are used as soon as they come; between them the pose grows old."""
    slow = replace(RULES, slow_hz=5.0)
    flight = []
    for k in range(3 * SECOND):
        last = k - k % 8
        now = with_seen(healthy(last), age_s=(k - last) * CYCLE_S + 1.0 / 64.0)
        flight.append(replace(now, time_s=healthy(k).time_s, late_s=0.0))
    assert not when(watched(flight, slow), Fault.MOCAP_DELAYED)


def delayed_by(now: HealthInputs, delay_s: float) -> HealthInputs:
    """The estimator's clock has got used to it: the age does not show it."""
    return with_seen(now, stamp_s=now.mocap.stamp_s - delay_s, frame=now.mocap.frame - round(delay_s / CYCLE_S))


@pytest.mark.parametrize(("delay_s", "told"), [(0.0625, False), (0.0703125, True)])
def test_a_latency_that_grew_is_a_delay_for_minutes(delay_s: float, told: bool) -> None:
    rare = replace(RULES, slow_hz=5.0)
    flight = [healthy(k) for k in range(SECOND)]
    flight += [delayed_by(healthy(k), delay_s) for k in range(SECOND, 3 * SECOND)]
    flight += [delayed_by(healthy(k), delay_s) for k in range(3 * SECOND, 63 * SECOND, 16)]
    events = watched(flight, rare)
    half = SECOND + SECOND // 4
    assert when(events, Fault.MOCAP_DELAYED) == (list(range(half, len(flight))) if told else [])


@pytest.mark.parametrize(("drift", "told"), [(9e-5, False), (-1e-3, False), (2e-4, True)])
def test_clocks_may_part_slowly(drift: float, told: bool) -> None:
    """A quarter of an hour, four frames a second."""
    rare = replace(RULES, slow_hz=5.0)
    flight = [
        with_seen(now := healthy(k), stamp_s=now.mocap.stamp_s - drift * k * CYCLE_S) for k in range(0, 115200, 32)
    ]
    assert bool(when(watched(flight, rare), Fault.MOCAP_DELAYED)) is told


def test_a_drift_beyond_crystals_shows_when_it_adds_up() -> None:
    rare = replace(RULES, slow_hz=3.0)
    flight = [with_seen(now := healthy(k), stamp_s=now.mocap.stamp_s - 3e-4 * k * CYCLE_S) for k in range(0, 57600, 32)]
    first = when(watched(flight, rare), Fault.MOCAP_DELAYED)[0] * 32 * CYCLE_S
    assert first == pytest.approx(0.0625 / (3e-4 - 1e-4), abs=1.0)


def jumped(cycle: int, by_s: float) -> HealthInputs:
    now = healthy(cycle)
    return with_seen(now, stamp_s=now.mocap.stamp_s + by_s)


@pytest.mark.parametrize(
    ("by_s", "words"), [(0.1328125, "+0.13"), (-0.1328125, "-0.13"), (30.0, "+30.00"), (-0.5, "-0.50")]
)
def test_stamps_that_jump_and_stay_so_are_a_clock_jump(by_s: float, words: str) -> None:
    flight = [healthy(k) for k in range(10)] + [jumped(k, by_s) for k in range(10, 3 * SECOND)]
    events = watched(flight)
    assert when(events, Fault.MOCAP_CLOCK_JUMP) == list(range(12, 3 * SECOND))
    text = f"motion capture's stamps jumped by {words} s against their arrival"
    assert events[12] == events[-1] == (Event(Fault.MOCAP_CLOCK_JUMP, text),)


@pytest.mark.parametrize("by_s", [0.125, -0.125])
def test_a_small_step_is_none(by_s: float) -> None:
    flight = [healthy(k) for k in range(10)] + [jumped(k, by_s) for k in range(10, SECOND)]
    assert not when(watched(flight), Fault.MOCAP_CLOCK_JUMP)


def test_a_small_step_is_none_whatever_the_frame_number_says() -> None:
    flight = [healthy(k) for k in range(10)]
    flight += [with_seen(jumped(k, 0.125), frame=k - 1000) for k in range(10, SECOND)]
    assert not when(watched(flight), Fault.MOCAP_CLOCK_JUMP)


def test_a_small_step_from_the_frame_number_is_none_whatever_the_arrival_says() -> None:
    flight = [healthy(k) for k in range(10)]
    for k in range(10, SECOND):
        now = jumped(k, -0.125)
        flight.append(with_seen(now, received_s=now.mocap.received_s + 0.25))
    assert not when(watched(flight), Fault.MOCAP_CLOCK_JUMP)


def test_steps_do_not_add_up_to_a_jump() -> None:
    assert not when(watched([jumped(k, 0.125 * (k // 10)) for k in range(SECOND)]), Fault.MOCAP_CLOCK_JUMP)


def test_two_broken_stamps_are_no_jump_and_leave_no_delay() -> None:
    flight = [jumped(k, 5.0) if k in {20, 21, 30, 31} else healthy(k) for k in range(3 * SECOND)]
    assert not any(watched(flight))
    flight = [jumped(k, -5.0) if k in {20, 21, 30, 31} else healthy(k) for k in range(3 * SECOND)]
    assert not any(watched(flight))


def test_many_broken_stamps_are_no_delay_either() -> None:
    flight = [jumped(k, -5.0) if k > 20 and k % 3 else healthy(k) for k in range(3 * SECOND)]
    assert not any(watched(flight))


def test_a_jump_is_told_as_long_as_setpoints_leave() -> None:
    flight = [healthy(k) for k in range(10)] + [jumped(k, 5.0) for k in range(10, 20)]
    down = [on_ground(jumped(20, 5.0)), jumped(21, 5.0), on_ground(healthy(21)), jumped(22, 5.0)]
    assert when(watched([*flight, *down]), Fault.MOCAP_CLOCK_JUMP) == list(range(12, 20))


def test_a_jump_is_told_while_the_autopilot_flies_on_the_poses() -> None:
    flight = [handed_over(healthy(k)) for k in range(10)] + [handed_over(jumped(k, 5.0)) for k in range(10, 20)]
    down = [with_status(handed_over(jumped(k, 5.0)), armed=False) for k in range(20, 22)]
    assert when(watched([*flight, *down]), Fault.MOCAP_CLOCK_JUMP) == list(range(12, 20))
    slow = [handed_over(now) for now in seldom_usable(range(2 * SECOND), 20)]
    assert when(watched(slow), Fault.MOCAP_SLOW)


def test_a_jump_before_anything_is_sent_is_taken_as_it_is() -> None:
    flight = [on_ground(healthy(k)) for k in range(10)] + [on_ground(jumped(k, -5.0)) for k in range(10, 20)]
    assert not any(watched([*flight, *(jumped(k, -5.0) for k in range(20, 2 * SECOND))]))


def test_a_first_stamp_that_is_broken_leaves_no_delay() -> None:
    first = on_ground(jumped(0, 5.0))
    assert not any(
        watched([first, *(on_ground(healthy(k)) for k in range(1, 10)), *(healthy(k) for k in range(10, 200))])
    )


def test_a_jump_just_before_the_first_setpoint_is_taken_as_it_is_too() -> None:
    flight = [on_ground(healthy(k)) for k in range(10)] + [on_ground(jumped(k, -5.0)) for k in range(10, 13)]
    assert not any(watched([*flight, *(jumped(k, -5.0) for k in range(13, 60))]))


def test_a_clock_that_jumps_again_at_once_is_given_three_frames_again() -> None:
    flight = [healthy(k) for k in range(10)] + [jumped(k, 5.0) for k in range(10, 13)]
    events = watched([*flight, *(jumped(k, 7.0) for k in range(13, 20))])
    assert ["+5.00" in found[0].text for found in events[12:16]] == [True, True, True, False]
    assert "+2.00" in events[15][0].text


def test_without_numbers_a_delay_that_comes_at_once_is_a_clock_that_jumped() -> None:
    flight = [healthy(k) for k in range(100)] + [delayed_by(healthy(k), 0.1875) for k in range(100, 120)]
    alike = [with_seen(now, frame=1) for now in flight]
    assert when(watched(alike), Fault.MOCAP_CLOCK_JUMP) == list(range(102, 120))


def test_a_clock_that_jumped_does_not_hide_a_delay() -> None:
    flight = [healthy(k) for k in range(10)] + [jumped(k, 5.0) for k in range(10, 2 * SECOND)]
    late_too = [with_seen(now, age_s=0.25) for now in flight]
    assert {Fault.MOCAP_CLOCK_JUMP, Fault.MOCAP_DELAYED} <= set(faults(watched(late_too)[-1]))


def test_a_frame_that_comes_after_a_silence_begins_no_second() -> None:
    memory, _ = check_stream(StreamHealth(), late(0, 0.2501), RULES, new=True)
    assert memory.begun_s == NOT_HELD
    memory, _ = check_stream(memory, late(1, 0.25), RULES, new=True)
    assert memory.begun_s == healthy(1).time_s


def test_two_jumps_are_two() -> None:
    flight = [healthy(k) for k in range(10)] + [jumped(k, 5.0) for k in range(10, 20)]
    events = watched([*flight, *(jumped(k, 7.0) for k in range(20, 30))])
    assert "+5.00" in events[21][0].text
    assert "+2.00" in events[22][0].text


def test_a_new_measurement_counts_from_zero() -> None:
    again = [with_seen(healthy(k), frame=k - 200, stamp_s=(k - 200) * CYCLE_S) for k in range(200, 300)]
    events = watched([*(healthy(k) for k in range(200)), *again])
    assert when(events, Fault.MOCAP_CLOCK_JUMP) == list(range(202, 300))


def test_frames_from_before_a_reordering_are_no_jump() -> None:
    flight = [healthy(k) for k in range(40)]
    for k in (30, 31):
        old = healthy(k - 20).mocap
        flight[k] = with_seen(flight[k], frame=old.frame, stamp_s=old.stamp_s, verdict=Verdict.STALE)
    assert not any(watched(flight))


def test_a_stalled_network_that_delivers_all_at_once_is_no_jump() -> None:
    """Thirty frames are held back; the first comes that much late, the rest in the next cycles, two at a time."""
    flight = [healthy(k) for k in range(100)]
    for k in range(100, 130):
        flight.append(replace(flight[99], time_s=healthy(k).time_s, autopilot=healthy(k).autopilot))
    for k in range(130, 150):
        held = healthy(100 + 2 * (k - 130) if k < 145 else k)
        flight.append(with_seen(healthy(k), frame=held.mocap.frame, stamp_s=held.mocap.stamp_s))
    flight += [healthy(k) for k in range(150, 300)]
    assert not any(watched(flight))


@pytest.mark.parametrize("per_cycle", [1, 2])
def test_a_delay_that_comes_and_goes_is_a_delay_and_no_jump(per_cycle: int) -> None:
    """Cameras may be faster than the loop."""
    flight = [healthy(k) for k in range(100)]
    flight += [replace(flight[99], time_s=(now := healthy(k)).time_s, autopilot=now.autopilot) for k in range(100, 124)]
    flight += [delayed_by(healthy(k), 0.1875) for k in range(124, 300)]
    flight += [healthy(k) for k in range(300, 500)]
    events = watched([with_seen(now, frame=per_cycle * now.mocap.frame) for now in flight])
    assert not when(events, Fault.MOCAP_CLOCK_JUMP)
    assert when(events, Fault.MOCAP_DELAYED) == list(range(144, 331))


def test_a_clock_that_jumped_begins_anew_with_delays() -> None:
    rare = replace(RULES, slow_hz=5.0)
    flight = [healthy(k) for k in range(100)] + [jumped(k, -5.0) for k in range(100, 400)]
    flight += [delayed_by(jumped(k, -5.0), 0.1015625) for k in range(400, 600)]
    assert when(watched(flight, rare), Fault.MOCAP_DELAYED) == list(range(432, 600))


@pytest.mark.parametrize("stamp_s", [math.nan, math.inf, -math.inf])
def test_stamps_that_are_no_numbers_do_no_lasting_harm(stamp_s: float) -> None:
    flight = [with_seen(healthy(k), stamp_s=stamp_s) if k in {10, 20, 21} else healthy(k) for k in range(2 * SECOND)]
    assert not any(watched(flight))
