"""PX4's own order of messages at the end of a landing, and ours: nothing is asked of a vehicle that disarms."""

from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import FlightMode
from companion.supervisor.faults import Event, Fault
from companion.supervisor.flight_state import Action, FlightInputs, FlightState, HandOverRequest, Phase
from companion.supervisor.health.autopilot import AutopilotHealth, check_autopilot
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.state_machine import advance
from tests.supervisor.flown import DT_S, GROUND, RULES, STATES, apply_request, facts
from tests.supervisor.observing import healthy
from tests.supervisor.recorded_landings import LANDINGS, TOUCHDOWN_TO_LANDED_S, Landing, Seen

SAFETY = SafetyRules()


def facts_of(seen: Seen, events: tuple[Event, ...] = ()) -> FlightInputs:
    known = facts(seen.time_s, 0.5 if seen.in_air else 0.0, armed=seen.armed, mode=seen.mode)
    return replace(known, in_air=seen.in_air, events=events)


def events_of(flight: FlightState, seen: Seen) -> tuple[Event, ...]:
    """Return what the health checks say of the autopilot, which is heard all the time."""
    usual = healthy(0)
    status = replace(usual.autopilot, armed=seen.armed, mode=seen.mode, in_air=seen.in_air, heard_s=seen.time_s)
    asked_s = flight.landing_asked_s if seen.mode is FlightMode.OFFBOARD else float("inf")
    observed = replace(usual, time_s=seen.time_s, autopilot=status, commanded=False, land_asked_s=asked_s)
    return tuple(check_autopilot(AutopilotHealth(), observed, SAFETY)[1])


def begun(landing: Landing) -> FlightState:
    hovering, _ = STATES["hovering"]
    now = facts(landing.given_up_s, 0.5)
    if not landing.taken:
        return apply_request(hovering, HandOverRequest("motion capture is silent"), now, RULES)
    taken = Event(Fault.MODE_CHANGED, "the autopilot shows mode land, not offboard")
    return advance(hovering, replace(now, mode=FlightMode.LAND, events=(taken,)), RULES)


@pytest.mark.parametrize("landing", LANDINGS, ids=lambda landing: landing.name)
def test_px4s_fall_back_to_offboard_when_it_disarms_is_no_refused_landing(landing: Landing) -> None:
    flight = begun(landing)
    reason, actions = flight.reason, []
    for seen in landing.seen():
        flight = advance(flight, facts_of(seen, events_of(flight, seen)), RULES)
        actions.append(flight.action)
    assert [action for action in actions if action] == [], "a disarmed PX4 takes NAV_LAND, and stands in LAND then"
    assert (flight.phase, flight.reason) == (Phase.DISARMED, reason)
    assert flight.since_s == pytest.approx(landing.end_s, abs=2 * DT_S)


def after(flight: FlightState, start_s: float, for_s: float, seen: FlightInputs) -> list[float]:
    """Return when PX4 was told to land (s after `start_s`), while nothing changes."""
    asked_s = []
    for n in range(1, round(for_s / DT_S) + 1):
        flight = advance(flight, replace(seen, time_s=start_s + n * DT_S), RULES)
        asked_s += [n * DT_S] if flight.action is Action.AUTOPILOT_LAND else []
    return asked_s


def landing_seen() -> tuple[FlightState, float]:
    flight, time_s = STATES["handed over"]
    return advance(flight, facts(time_s + 3.0, 0.5, mode=FlightMode.LAND), RULES), time_s + 3.0


def test_offboard_again_in_the_air_is_told_to_land_at_once() -> None:
    flight, time_s = landing_seen()
    assert flight.left_offboard
    for in_air in (True, None):
        asked_s = after(flight, time_s, 3.0, replace(facts(time_s, 0.5), in_air=in_air))
        assert asked_s == pytest.approx([DT_S, DT_S + RULES.land_again_s], abs=2 * DT_S)


def test_offboard_again_on_the_ground_is_told_to_land_if_it_stays_armed() -> None:
    flight, time_s = landing_seen()
    asked_s = after(flight, time_s, 4.0, replace(facts(time_s), in_air=False))
    assert asked_s == pytest.approx([DT_S + RULES.disarm_shows_s], abs=2 * DT_S)


def test_each_time_that_it_shows_offboard_again_is_waited_for_anew() -> None:
    flight, time_s = landing_seen()
    landed = replace(facts(time_s), in_air=False)
    flight = advance(flight, replace(landed, time_s=time_s + 1.0), RULES)
    assert flight.offboard_again_s == time_s + 1.0
    flight = advance(flight, replace(landed, time_s=time_s + 2.0, mode=FlightMode.LAND), RULES)
    asked_s = after(flight, time_s + 2.0, 4.0, landed)
    assert asked_s == pytest.approx([DT_S + RULES.disarm_shows_s], abs=2 * DT_S)


def test_a_landing_that_was_never_begun_is_told_again_on_the_ground_too() -> None:
    flight, time_s = STATES["handed over"]
    asked_s = after(flight, time_s, 3.0, replace(facts(time_s), in_air=False))
    assert asked_s == pytest.approx([RULES.land_again_s], abs=2 * DT_S)


def test_a_landing_that_px4_has_begun_is_not_refused_any_more() -> None:
    flight, time_s = landing_seen()
    assert flight.landing_asked_s == float("inf")
    assert STATES["handed over"][0].landing_asked_s < time_s


@pytest.mark.parametrize(("theirs", "in_air", "phase"), [
    (True, False, Phase.HANDED_OVER), (True, True, Phase.TERMINATED), (True, None, Phase.TERMINATED),
    (False, False, Phase.TERMINATED),
])  # fmt: skip
def test_a_pilots_landing_beyond_the_fence_is_not_killed_when_it_disarms(
    theirs: bool, in_air: bool | None, phase: Phase
) -> None:
    """It shows OFFBOARD for up to a second before the armed bit follows."""
    flight, time_s = landing_seen()
    out = Event(Fault.ROOM_LEFT, "2 m beyond the fence")
    seen = replace(facts(time_s + 1.0), in_air=in_air, events=(out,), position_w_m=GROUND + np.array([9.0, 0.0, 0.0]))
    assert advance(replace(flight, theirs=theirs), seen, RULES).phase is phase


@pytest.mark.parametrize(("in_air", "asked_s"), [
    (False, RULES.touchdown_s), (None, RULES.disarm_wait_unknown_s), (True, RULES.disarm_wait_in_air_s),
])  # fmt: skip
def test_disarming_is_asked_for_when_px4_says_landed_or_may_have_missed_it(in_air: bool | None, asked_s: float) -> None:
    flight, time_s = STATES["touched down"]
    asked = []
    for n in range(1, 400):
        flight = advance(flight, replace(facts(time_s + n * DT_S), in_air=in_air), RULES)
        asked += [n * DT_S] if flight.action is Action.DISARM else []
    assert asked == pytest.approx([asked_s], abs=3 * DT_S)


@pytest.mark.parametrize("landed_s", sorted(set(TOUCHDOWN_TO_LANDED_S)))
def test_no_recorded_landing_of_ours_would_be_denied_disarming(landed_s: float) -> None:
    """The land detector's message comes at 5 Hz."""
    flight, time_s = STATES["touched down"]
    now_s = 0.0
    while flight.action is not Action.DISARM:
        now_s += DT_S
        flight = advance(flight, replace(facts(time_s + now_s), in_air=now_s < landed_s + 0.1), RULES)
    assert landed_s <= now_s <= landed_s + 0.2
