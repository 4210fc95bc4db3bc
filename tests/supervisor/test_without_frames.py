"""A vehicle that motion capture's frames do not reach: what is off, what is not, and the words for it."""

import math
from collections.abc import Iterable
from dataclasses import replace

import pytest

from companion.supervisor.faults import Fault, PoseNeed
from companion.supervisor.health.checks import Health, assess
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.without_frames import OFF, OFF_BY_NEED, off_sentence, off_words
from tests.supervisor.observing import (
    CYCLE_S,
    FENCE,
    RULES,
    faults,
    healthy,
    tilted,
    with_seen,
    with_status,
    with_vehicle,
)


def told(flight: Iterable[HealthInputs], off: frozenset[Fault] = OFF) -> set[Fault]:
    """Return all faults reported in a flight."""
    memory, seen = Health(), set[Fault]()
    for now in flight:
        memory, events = assess(memory, now, RULES, FENCE, off)
        seen |= set(faults(events))
    return seen


def frameless(cycle: int) -> HealthInputs:
    """A hover in which no frame ever came."""
    gone = with_seen(healthy(cycle), verdict=None, frame=-1, stamp_s=math.nan, received_s=math.nan)
    now_s = gone.time_s
    return with_status(gone, heard_s=now_s, attitude_s=now_s)


def test_what_motion_capture_shows_is_off_and_nothing_else() -> None:
    kept = {fault for fault in Fault if fault not in OFF}
    assert not {fault for fault in kept if fault.startswith(("mocap", "fence", "tracking", "room"))}
    assert {Fault.LIFT_OFF_UNSEEN, Fault.SETPOINT_NOT_FOLLOWED, Fault.LAW_FAILED, Fault.BATTERY_CRITICAL} <= kept
    assert len(OFF) == sum(map(len, OFF_BY_NEED.values())), "each for one reason"


def test_a_hover_without_frames_has_no_events() -> None:
    flight = [with_seen(frameless(k), age_s=1.0) for k in range(400)]
    assert told(flight) == set()
    assert told(flight, frozenset()) == {Fault.MOCAP_SILENT}


@pytest.mark.parametrize("place", [(9.0, 0.0, 1.0), (0.5, -0.25, 9.0)])
def test_a_position_beyond_the_fence_and_the_reference_leads_to_nothing(place: tuple[float, float, float]) -> None:
    flight = [replace(frameless(k), reference_w_m=healthy(k).reference_w_m) for k in range(200)]
    flight[100:] = [with_vehicle(now, position_w_m=healthy(0, place).reference_w_m) for now in flight[100:]]
    assert told(flight) == set()
    assert {Fault.ROOM_LEFT, Fault.TRACKING_LOST} <= told(flight, frozenset())


def test_what_needs_no_pose_is_recognised_as_ever() -> None:
    low = [with_status(frameless(k), battery_fraction=0.05) for k in range(200)]
    assert told(low) == {Fault.BATTERY_CRITICAL}
    assert told(replace(frameless(k), law_fault="no") for k in range(5)) == {Fault.LAW_FAILED}
    silent = [replace(frameless(0), time_s=frameless(0).time_s + k * CYCLE_S) for k in range(200)]
    assert told(silent) == {Fault.AUTOPILOT_SILENT}


def test_a_wrong_horizon_that_is_off_does_not_weaken_an_empty_battery() -> None:
    flight = [with_status(healthy(k), q_w_flu_wxyz=tilted(0.4), battery_fraction=0.05) for k in range(200)]
    assert {Fault.HORIZON_WRONG, Fault.BATTERY_LOW} <= told(flight, frozenset())
    assert told(flight) & {Fault.HORIZON_WRONG, Fault.BATTERY_LOW, Fault.BATTERY_CRITICAL} == {Fault.BATTERY_CRITICAL}


def test_the_words_name_every_fault_and_the_reason() -> None:
    sentences = [off_words(OFF_BY_NEED[need]) for need in PoseNeed]
    for sentence in (*sentences, off_sentence()):
        assert sentence.startswith("off: ")
        assert sentence.endswith(", because frames do not reach the vehicle")
    for fault in OFF:
        assert any(fault in sentence for sentence in sentences)
    for need in PoseNeed:
        assert need in off_sentence()
