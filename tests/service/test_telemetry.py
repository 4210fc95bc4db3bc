"""Tests of telemetry: events at once, and states that agree with the tick."""

import asyncio
import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import OtherBody
from companion.estimation import others
from companion.estimation.params import EstimatorParams
from companion.protocol.telemetry import WAITING, Doing, Happened, Kind, Other, State
from companion.service.telemetry import Telemetry
from companion.supervisor.flight_state import Phase
from tests.flights.simulated import Flight, fly
from tests.flights.test_simulated_flights import UP, inject, until, wait

SESSION = "0123456789abcdef"
Said = tuple[Telemetry, list[Happened], list[State]]


@pytest.fixture(scope="module")
def silent() -> Flight:
    return asyncio.run(fly([*UP, wait(1.0), inject("mocap off"), until(Phase.HANDED_OVER), wait(0.5)]))


def told(flight: Flight) -> Said:
    events: list[Happened] = []
    states = []
    telemetry = Telemetry(SESSION, events.append)
    for number, tick in enumerate(flight.ticks):
        telemetry(tick)
        if number % 10 == 0:
            states.append(telemetry.state(Doing(id="a", verb="takeoff"), 100.0))
    return telemetry, events, states


@pytest.fixture(scope="module")
def said(silent: Flight) -> Said:
    return told(silent)


def test_every_phase_is_told_once_in_its_order(silent: Flight, said: Said) -> None:
    phases = [event.name for event in said[1] if event.kind is Kind.PHASE]
    assert phases == [str(phase) for phase in silent.phases()]


def test_a_fault_is_told_with_the_reaction_it_leads_to(said: Said) -> None:
    """Not with the one that follows it where it has led."""
    faults = {event.name: event.reaction for event in said[1] if event.kind is Kind.FAULT}
    assert faults["mocap silent"] == "PX4 lands"
    assert faults["mocap late"] == "warn"


def test_states_say_what_the_ticks_say(silent: Flight, said: Said) -> None:
    for state, tick in zip(said[2], silent.ticks[::10], strict=True):
        assert state.phase == tick.flight.phase
        assert State.model_validate_json(state.model_dump_json()) == state, "it can be sent"
        if tick.vehicle is not None and tick.reference is not None:
            assert state.position_w_m == tuple(tick.vehicle.position_w_m)
            off_m = float(np.linalg.norm(tick.vehicle.position_w_m - tick.reference.position_w_m))
            assert state.error_m == pytest.approx(off_m)
            assert state.q_w_flu_wxyz == tuple(tick.vehicle.q_w_flu_wxyz)
        assert state.px4_age_s == pytest.approx(max(0.0, tick.time_s - tick.status.heard_s))
        if state.tilt_rad is not None:
            assert 0.0 <= state.tilt_rad < 0.6
        assert state.age_s is None or math.isfinite(state.age_s)
    shares = [state.sent_share for state in said[2] if state.sent_share is not None]
    assert 0.0 < np.median(shares) < 0.5, "event-triggered"


def test_a_motion_is_told_how_long_it_still_takes_and_a_hover_has_no_end(silent: Flight, said: Said) -> None:
    told_s = [(tick, state.remaining_s) for tick, state in zip(silent.ticks[::10], said[2], strict=True)]
    climbs = [(tick.time_s, left_s) for tick, left_s in told_s if tick.flight.phase is Phase.TAKEOFF and left_s]
    ends_s = [time_s + left_s for time_s, left_s in climbs]
    hovers_s = next(tick.time_s for tick in silent.ticks if tick.flight.phase is Phase.HOLD)
    assert len(climbs) > 10
    assert ends_s == pytest.approx([hovers_s] * len(ends_s), abs=0.02)
    assert not any(left_s for tick, left_s in told_s if tick.flight.phase in {Phase.HANDED_OVER, Phase.STANDBY})
    assert told_s[-1][1] is None


def test_without_a_vehicle_a_state_says_what_is_waited_for() -> None:
    telemetry = Telemetry(SESSION, lambda _: None)
    assert telemetry.state(None, 100.0).phase == WAITING
    telemetry.forget("no QTM at 127.0.0.1")
    assert telemetry.state(None, 100.0).reason == "no QTM at 127.0.0.1"


def test_what_is_wrong_beside_the_vehicle_is_an_event_once_and_stands_in_every_state() -> None:
    events: list[Happened] = []
    telemetry = Telemetry(SESSION, events.append)
    for warnings in ((), ("no record",), ("no record",), ("no record", "two services"), ()):
        telemetry.warn(warnings)
        assert telemetry.state(None, 100.0).warnings == warnings
    assert [event.text for event in events] == ["no record", "two services", "over: no record", "over: two services"]
    assert {event.kind for event in events} == {Kind.LOG}


def test_after_a_loop_that_failed_the_handing_over_is_told(silent: Flight) -> None:
    events: list[Happened] = []
    telemetry = Telemetry(SESSION, events.append)
    before = next(tick for tick in silent.ticks if tick.flight.phase is Phase.HOLD)
    telemetry(before)
    flight = replace(before.flight, phase=Phase.HANDED_OVER, reason="the law failed")
    for step in range(3):
        telemetry.note_ended_loop(flight, replace(before.status, armed=False), before.time_s + 0.1 * step)
    assert [event.text for event in events if event.kind is Kind.PHASE][1:] == ["handed over: the law failed"]
    state = telemetry.state(None, 100.0)
    assert (state.phase, state.armed) == ("handed over", False)


def test_the_autopilots_words_grow_old(silent: Flight) -> None:
    telemetry = Telemetry(SESSION, lambda _: None)
    tick = silent.ticks[0]
    for time_s, text in ((0.0, ""), (1.0, "denied"), (43.0, "denied")):
        telemetry(replace(tick, time_s=time_s, status=replace(tick.status, last_text=text)))
    state = telemetry.state(None, 100.0)
    assert (state.text, state.text_age_s) == ("denied", 42.0)


def test_a_state_tells_where_the_other_vehicles_are(silent: Flight) -> None:
    params = EstimatorParams()
    seen = OtherBody("two", (3.0, 4.0, 1.0)), OtherBody("three", None)
    tick = next(tick for tick in silent.ticks if tick.vehicle is not None and tick.estimate is not None)
    assert tick.vehicle is not None
    assert tick.estimate is not None
    first = others.step((), seen, 1.0, params)
    tracks = others.step(first, (OtherBody("two", None), seen[1]), 1.25, params)
    here = replace(tick.vehicle, position_w_m=np.zeros(3))
    telemetry = Telemetry(SESSION, lambda _: None)
    telemetry(replace(tick, vehicle=here, estimate=replace(tick.estimate, others=tracks, others_s=1.25)))
    assert telemetry.state(None, 100.0).others == (
        Other(body="two", position_w_m=(3.0, 4.0, 1.0), age_s=0.25, distance_m=5.0),
        Other(body="three"),
    )
    telemetry(replace(tick, vehicle=None, estimate=replace(tick.estimate, others=tracks, others_s=1.25)))
    assert telemetry.state(None, 100.0).others[0].distance_m is None
    telemetry(replace(tick, estimate=None))
    assert telemetry.state(None, 100.0).others == ()
