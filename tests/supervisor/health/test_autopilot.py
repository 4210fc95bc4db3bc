"""The autopilot's link, mode and battery: at their limits."""

import math
from dataclasses import replace
from typing import Any

import pytest

from companion.core.types import BatteryReading, FlightMode
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.autopilot import REASON_WINDOW_S
from companion.supervisor.health_inputs import HealthInputs
from tests.supervisor.observing import CYCLE_S, RULES, faults, healthy, on_ground, text_of, watched, with_status


@pytest.mark.parametrize(
    ("ago_s", "text"),
    [
        (0.5, None),
        (0.5078125, "nothing heard from the autopilot for 0.51 s"),
        (math.inf, "nothing heard from the autopilot yet"),
    ],
)
def test_silent_after_its_time(ago_s: float, text: str | None) -> None:
    now = healthy(0)
    now = with_status(now, heard_s=now.time_s - ago_s)
    assert watched([now]) == [() if text is None else (Event(Fault.AUTOPILOT_SILENT, text),)]


def booted(cycle: int, boot_s: float) -> HealthInputs:
    return with_status(healthy(cycle), boot_s=boot_s)


def test_a_time_since_boot_that_goes_back_is_a_reboot() -> None:
    events = watched([booted(0, 100.0), booted(1, 98.75), booted(2, 98.8)])
    text = "the autopilot rebooted: its time since boot went from 100.0 s to 98.8 s"
    assert events == [(), (Event(Fault.AUTOPILOT_REBOOTED, text),), (Event(Fault.AUTOPILOT_REBOOTED, text),)]


def test_messages_that_overtake_each_other_are_none() -> None:
    assert not any(watched([booted(0, 100.0), booted(1, 99.0), booted(2, 100.0)]))


def test_an_unknown_time_since_boot_is_no_reboot_and_hides_none() -> None:
    events = watched([booted(0, math.nan), booted(1, 100.0), booted(2, math.nan), booted(3, 2.0)])
    assert [faults(found) for found in events] == [[], [], [], [Fault.AUTOPILOT_REBOOTED]]
    assert text_of(events[3], Fault.AUTOPILOT_REBOOTED).endswith("went from 100.0 s to 2.0 s")


def test_a_reboot_is_told_once_or_as_long_as_setpoints_leave() -> None:
    """Then the operator may begin anew."""
    flight = [booted(0, 100.0), on_ground(booted(1, 2.0)), on_ground(booted(2, 2.1)), booted(3, 2.2)]
    assert [len(found) for found in watched(flight)] == [0, 1, 0, 0]
    flight = [booted(0, 100.0), booted(1, 2.0), on_ground(booted(2, 2.1)), booted(3, 2.2)]
    assert [len(found) for found in watched(flight)] == [0, 1, 0, 0]


def test_disarmed_or_in_another_mode_while_commanded() -> None:
    disarmed = with_status(healthy(0), armed=False)
    assert watched([disarmed]) == [(Event(Fault.AUTOPILOT_DISARMED, "the autopilot disarmed without our asking"),)]
    assert watched([replace(disarmed, commanded=False)]) == [()]
    by_pilot = with_status(healthy(0), mode=FlightMode.POSITION)
    assert watched([by_pilot]) == [(Event(Fault.MODE_CHANGED, "the autopilot shows mode position, not offboard"),)]
    assert watched([replace(by_pilot, commanded=False)]) == [()]


def test_what_the_autopilot_has_just_said_of_a_change_is_told_with_it() -> None:
    now = healthy(0)
    for changes, text in (
        ({"armed": False}, "the autopilot disarmed without our asking"),
        ({"mode": FlightMode.LAND}, "the autopilot shows mode land, not offboard"),
    ):
        said = with_status(now, last_text="Failsafe activated", text_s=now.time_s - REASON_WINDOW_S, **changes)
        assert [event.text for event in watched([said])[0]] == [f"{text}: Failsafe activated"]
        old = with_status(said, text_s=now.time_s - REASON_WINDOW_S - 0.01)
        assert [event.text for event in watched([old])[0]] == [text], "long ago, and of something else"


def test_a_landing_that_is_refused() -> None:
    now = healthy(0)
    assert watched([replace(now, land_asked_s=now.time_s - 3.0)]) == [()]
    refused = replace(now, land_asked_s=now.time_s - 3.0078125)
    text = "the autopilot still shows offboard 3.0 s after it was told to land"
    assert watched([refused]) == [(Event(Fault.LAND_REFUSED, text),)]


def charged(charge: float, cycles: int = 80, **changes: Any) -> list[tuple[Event, ...]]:
    return watched([with_status(healthy(k), battery_fraction=charge, **changes) for k in range(cycles)])


@pytest.mark.parametrize(
    ("charge", "event"),
    [
        (0.25, None),
        (0.2499, Event(Fault.BATTERY_LOW, "25 % of the battery's charge left, below 25 %")),
        (0.125, Event(Fault.BATTERY_LOW, "12 % of the battery's charge left, below 25 %")),
        (0.1249, Event(Fault.BATTERY_CRITICAL, "12 % of the battery's charge left, below 12 %")),
        (0.0, Event(Fault.BATTERY_CRITICAL, "0 % of the battery's charge left, below 12 %")),
        (-0.01, None),
        (math.nan, None),
        (math.inf, None),
        (-math.inf, None),
    ],
)
def test_a_battery_is_low_or_critical_after_half_a_second(charge: float, event: Event | None) -> None:
    events = charged(charge)
    assert not any(events[:64])
    assert set(events[64:]) == {() if event is None else (event,)}


def test_the_battery_is_named_by_its_number_where_there_are_two() -> None:
    two = tuple(BatteryReading(id=number, fraction=0.2, voltage_v=12.0) for number in (0, 1))
    events = watched([with_status(healthy(k), battery_fraction=0.2, batteries=two, battery_id=0) for k in range(80)])
    assert events[-1] == (Event(Fault.BATTERY_LOW, "20 % of battery 0's charge left, below 25 %"),)


def test_one_bad_sample_is_no_flat_battery() -> None:
    flight = [with_status(healthy(k), battery_fraction=0.5 if k == 40 else 0.05) for k in range(104)]
    assert not any(watched(flight))
    flight = [with_status(healthy(k), battery_fraction=0.2 if k == 40 else 0.05) for k in range(106)]
    events = watched(flight)
    assert [faults(found) for found in (events[63], events[64], events[104], events[105])] == [
        [],
        [Fault.BATTERY_LOW],
        [Fault.BATTERY_LOW],
        [Fault.BATTERY_CRITICAL],
    ]
    assert CYCLE_S * 64 == 0.5


def test_a_battery_that_says_it_is_empty_is_low_whatever_is_critical() -> None:
    rules = replace(RULES, battery_low=0.5, battery_critical=0.0)
    events = watched([with_status(healthy(k), battery_fraction=0.0) for k in range(80)], rules)
    assert events[-1] == (Event(Fault.BATTERY_LOW, "0 % of the battery's charge left, below 50 %"),)
    rules = replace(rules, battery_low=0.75)
    events = watched([with_status(healthy(k), battery_fraction=0.0) for k in range(80)], rules)
    assert events[-1][0].text.endswith("below 75 %")
