"""Whatever happens in whatever order: the machine keeps its promises."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.core.types import FlightMode
from companion.supervisor.faults import TABLE, Event, FailsafeAction, Fault
from companion.supervisor.flight_state import (
    COMMANDED,
    IN_THE_AIR,
    STREAMING,
    Action,
    ArmRequest,
    FlightInputs,
    FlightState,
    HandOverRequest,
    HoldRequest,
    KillRequest,
    LandRequest,
    Phase,
    Request,
    ResumeRequest,
    TakeoffRequest,
    TrackRequest,
)
from companion.supervisor.state_machine import advance, ground_thrust, reference_at
from tests.supervisor.flown import CURVE, GROUND, RULES, STATES, apply_request

WAYS: dict[Phase, set[Phase]] = {
    Phase.STANDBY: {Phase.PREFLIGHT},
    Phase.PREFLIGHT: {Phase.ARMED, Phase.DISARMED, Phase.LAND, Phase.HANDED_OVER},
    Phase.ARMED: {Phase.TAKEOFF, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.TAKEOFF: {Phase.HOLD, Phase.STOW, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.HOLD: {Phase.TRACK, Phase.STOW, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.TRACK: {Phase.HOLD, Phase.STOW, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.STOW: {Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.LAND: {Phase.DISARMED, Phase.HANDED_OVER},
    Phase.DISARMED: {Phase.PREFLIGHT},
    Phase.HANDED_OVER: {Phase.RESUME, Phase.DISARMED},
    Phase.RESUME: {Phase.HOLD, Phase.HANDED_OVER, Phase.DISARMED},
    Phase.TERMINATED: {Phase.PREFLIGHT},
}
"""Every way there is, apart from the one to TERMINATED, which leads from everywhere."""
BEGINNING_ANEW = (ArmRequest, TrackRequest, ResumeRequest)
SILENT = FlightInputs(
    time_s=0.0,
    position_w_m=GROUND,
    velocity_w_mps=np.zeros(3),
    yaw_rad=0.0,
    armed=True,
    mode=FlightMode.OFFBOARD,
    events=(Event(Fault.AUTOPILOT_SILENT, "silent"),),
)

heights_m = st.sampled_from([-0.1, 0.0, 0.03, 0.3, 1.2, 2.5, float("nan")])
speeds_mps = st.sampled_from([-1.0, -0.03, 0.0, 0.03, 0.5])
events = st.sets(st.sampled_from(list(Fault)), max_size=2).map(
    lambda faults: tuple(Event(row.fault, str(row.fault)) for row in TABLE if row.fault in faults)
)
quiet = st.just(())
requests: st.SearchStrategy[Request] = st.sampled_from(
    [
        ArmRequest(),
        TakeoffRequest(1.2),
        TrackRequest(CURVE, 1.0),
        HoldRequest(),
        LandRequest(),
        HandOverRequest("it broke"),
        ResumeRequest(),
        KillRequest(),
    ]
)


@st.composite
def some_facts(draw: st.DrawFn) -> FlightInputs:
    """Mostly a vehicle that does as told, seen `time_s` after the last time."""
    return FlightInputs(
        time_s=draw(st.sampled_from([0.01, 0.02, 0.3, 1.0, 7.0])),
        position_w_m=GROUND + np.array([0.0, 0.0, draw(heights_m)]),
        velocity_w_mps=np.array([0.0, 0.0, draw(speeds_mps)]),
        yaw_rad=0.3,
        armed=draw(st.sampled_from([True, True, True, True, False])),
        mode=draw(st.sampled_from([FlightMode.OFFBOARD] * 3 + [FlightMode.LAND, FlightMode.POSITION])),
        arms_stowed=draw(st.booleans()),
        arm_fault=draw(st.sampled_from(["", "", "a servo"])),
        cannot_stow=draw(st.sampled_from(["", "", "a cable"])),
        events=draw(quiet | quiet | events),
        in_air=draw(st.sampled_from((None, False, True))),
        failsafe=draw(st.booleans()),
        thrust=draw(st.sampled_from([0.1, 0.5, 0.5, float("nan")])),
    )


steps = st.lists(st.tuples(some_facts(), st.none() | st.none() | requests), min_size=1, max_size=30)


def check(before: FlightState, after: FlightState, wanted: Request | None, seen: FlightInputs) -> None:
    way = before.phase, after.phase
    assert after.phase in WAYS[before.phase] | {before.phase, Phase.TERMINATED}, way
    anew = after is not before and isinstance(wanted, BEGINNING_ANEW)
    assert anew or after.level >= before.level, "only the operator goes back"
    if after.phase in COMMANDED and before.phase not in COMMANDED:
        assert before.phase in {Phase.PREFLIGHT, Phase.RESUME}, way
        assert seen.armed
        assert seen.mode is FlightMode.OFFBOARD
    if after.phase in STREAMING and before.phase not in STREAMING:
        assert isinstance(wanted, ArmRequest | ResumeRequest), "a stream once ended begins on the operator's command"
    assert not after.airborne or after.phase in IN_THE_AIR
    assert (after.level is FailsafeAction.TERMINATE) == (after.phase is Phase.TERMINATED)
    assert after.phase is not Phase.HANDED_OVER or after.level >= FailsafeAction.AUTOPILOT_LAND
    assert not (before.touched_down and after.airborne), "the law does not begin again on the ground"
    allowed = {
        Action.DISARM: after.phase is Phase.LAND and after.touched_down,
        Action.AUTOPILOT_LAND: after.phase is Phase.HANDED_OVER,
        Action.OFFBOARD: after.phase is Phase.RESUME,
        Action.KILL: after.phase is Phase.TERMINATED,
    }
    assert after.action is None or after is before or allowed[after.action], (way, after.action)
    if after.airborne:
        assert after.legs
        reference_at(after, seen.time_s + 0.1)
    assert 0.0 <= ground_thrust(after, seen.time_s, RULES) <= RULES.hover_thrust * RULES.ramp_overshoot


@settings(max_examples=100)
@given(state=st.sampled_from(sorted(STATES)), steps=steps)
def test_no_order_of_events_breaks_a_promise(state: str, steps: list[tuple[FlightInputs, Request | None]]) -> None:
    flight, time_s = STATES[state]
    for seen, wanted in steps:
        time_s += seen.time_s
        now = replace(seen, time_s=time_s)
        before, flight = flight, advance(flight, now, RULES)
        check(before, flight, None, now)
        if wanted is not None:
            before, flight = flight, apply_request(flight, wanted, now, RULES)
            check(before, flight, wanted, now)


@settings(max_examples=30)
@given(state=st.sampled_from(sorted(STATES)), steps=st.lists(some_facts(), max_size=10))
def test_who_lost_the_vehicle_does_not_get_it_back_by_itself(state: str, steps: list[FlightInputs]) -> None:
    """Everything but Resume and Prepare, against a vehicle that shows OFFBOARD again and again."""
    flight, time_s = STATES[state]
    if flight.phase in STREAMING:
        flight = advance(flight, replace(SILENT, time_s=time_s), RULES)
    assert flight.phase not in STREAMING
    for seen in steps:
        time_s += seen.time_s
        now = replace(seen, time_s=time_s)
        flight = advance(flight, now, RULES)
        for wanted in (
            TakeoffRequest(1.0),
            TrackRequest(CURVE, 1.0),
            HoldRequest(),
            LandRequest(),
            HandOverRequest("it broke"),
        ):
            flight = apply_request(flight, wanted, now, RULES)
        assert flight.phase not in STREAMING
