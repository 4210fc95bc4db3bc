"""The flight machine: every phase against every request and every combination of facts, and what ends a flight."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import FlightMode
from companion.supervisor import state_machine
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import (
    STREAMING,
    Action,
    ArmRequest,
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
from companion.supervisor.state_machine import advance, reference_at, refusal
from companion.trajectories.reference import FigureEight
from tests.supervisor.flown import (
    CENTRE,
    COMMANDED,
    CURVE,
    DT_S,
    GROUND,
    IN_THE_AIR,
    ON_THE_GROUND,
    RULES,
    STATES,
    apply_request,
    armed,
    bits,
    end_of,
    event,
    facts,
    hovering,
    on_reference,
    preflight,
    resuming,
    spooling,
    tracking,
    until,
    usual,
    with_faults,
)

_IN_FLIGHT = (Phase.TAKEOFF, Phase.HOLD, Phase.TRACK, Phase.STOW, Phase.LAND)

BY_REQUEST: dict[type, dict[Phase, Phase]] = {
    ArmRequest: dict.fromkeys((Phase.STANDBY, Phase.DISARMED, Phase.PREFLIGHT, Phase.TERMINATED), Phase.PREFLIGHT),
    TakeoffRequest: {Phase.ARMED: Phase.TAKEOFF},
    TrackRequest: {Phase.HOLD: Phase.HOLD, Phase.TRACK: Phase.HOLD},
    HoldRequest: {Phase.TAKEOFF: Phase.HOLD, Phase.HOLD: Phase.HOLD, Phase.TRACK: Phase.HOLD},
    LandRequest: {
        Phase.PREFLIGHT: Phase.DISARMED,
        Phase.ARMED: Phase.LAND,
        Phase.TAKEOFF: Phase.LAND,
        Phase.HOLD: Phase.LAND,
        Phase.TRACK: Phase.LAND,
        Phase.STOW: Phase.STOW,
        Phase.LAND: Phase.LAND,
        Phase.RESUME: Phase.HANDED_OVER,
        Phase.HANDED_OVER: Phase.HANDED_OVER,
    },
    HandOverRequest: dict.fromkeys((Phase.ARMED, *_IN_FLIGHT, Phase.RESUME), Phase.HANDED_OVER),
    ResumeRequest: {Phase.HANDED_OVER: Phase.RESUME},
    KillRequest: dict.fromkeys(Phase, Phase.TERMINATED),
}
"""All that a request may change; everything else is ignored."""

BY_FACTS: dict[Phase, set[Phase]] = {
    Phase.STANDBY: set(),
    Phase.PREFLIGHT: {Phase.ARMED},
    Phase.ARMED: {Phase.DISARMED},
    Phase.TAKEOFF: {Phase.HOLD, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.HOLD: {Phase.TRACK, Phase.DISARMED},
    Phase.TRACK: {Phase.HOLD, Phase.DISARMED},
    Phase.STOW: {Phase.LAND, Phase.DISARMED},
    Phase.LAND: {Phase.DISARMED},
    Phase.DISARMED: set(),
    Phase.HANDED_OVER: {Phase.DISARMED},
    Phase.RESUME: {Phase.HOLD, Phase.HANDED_OVER, Phase.DISARMED},
    Phase.TERMINATED: set(),
}
"""All that facts may change in one tick while nothing is wrong, besides staying."""

REQUESTS: list[Request] = [
    ArmRequest(), TakeoffRequest(1.2), TrackRequest(CURVE, 1.0), HoldRequest(), LandRequest(),
    HandOverRequest("it broke"), ResumeRequest(), KillRequest(),
]  # fmt: skip
EVERY_STATE = pytest.mark.parametrize("state", STATES)
BROKEN = "left.elbow_pitch (servo 6): overload"


def test_the_states_tried_cover_every_phase_and_the_requests_every_request() -> None:
    assert {flight.phase for flight, _ in STATES.values()} == set(Phase)
    assert {type(wanted) for wanted in REQUESTS} == set(BY_REQUEST)


@EVERY_STATE
@pytest.mark.parametrize("wanted", REQUESTS, ids=lambda wanted: type(wanted).__name__)
def test_a_request_does_what_the_table_says_and_nothing_else(state: str, wanted: Request) -> None:
    flight, time_s = STATES[state]
    table = BY_REQUEST[type(wanted)]
    fits = flight.phase in table and not (isinstance(wanted, HoldRequest) and not flight.airborne)
    seen = facts(time_s, 1.0, armed=flight.phase is not Phase.PREFLIGHT)
    assert (refusal(flight, wanted, seen, RULES) == "") == fits
    after = apply_request(flight, wanted, seen, RULES)
    if fits:
        assert after.phase is table[flight.phase]
    else:
        assert after is flight, f"{type(wanted).__name__} does not fit {flight.phase} and must be ignored"


@pytest.mark.parametrize(
    ("state", "wanted", "words"),
    [
        ("standby", TakeoffRequest(1.0), "the vehicle is disarmed; run `companion arm` first"),
        ("tracking", ResumeRequest(), "this service has the vehicle; there is nothing to take back"),
        ("spooling up", HoldRequest(), "the vehicle is not in the air yet; run `companion abort` to stop the motors"),
    ],
)
def test_a_refusal_says_why(state: str, wanted: Request, words: str) -> None:
    assert refusal(STATES[state][0], wanted, usual(state), RULES) == words
    assert state_machine.apply_request(STATES[state][0], wanted, usual(state), RULES) == (STATES[state][0], words)


@EVERY_STATE
def test_no_combination_of_facts_raises_or_leads_off_the_table(state: str) -> None:
    flight, time_s = STATES[state]
    modes = FlightMode.OFFBOARD, FlightMode.LAND, FlightMode.POSITION
    for mode, is_armed, height_m, climb_mps, later_s in itertools.product(
        modes, (False, True), (-0.2, 0.0, 0.05, 1.2), (-0.3, 0.0, 0.3), (0.01, 1.0, 100.0)
    ):
        clear = facts(time_s + later_s, height_m, climb_mps=climb_mps, armed=is_armed, mode=mode)
        for seen in (clear, replace(clear, arms_stowed=False), replace(clear, arms_stowed=False, arm_fault=BROKEN)):
            after = advance(flight, seen, RULES)
            allowed = BY_FACTS[flight.phase] | {flight.phase}
            assert after.phase in allowed, f"{flight.phase} -> {after.phase} on {seen}"
            if after.airborne:
                assert np.all(np.isfinite(reference_at(after, seen.time_s).position_w_m))


@EVERY_STATE
def test_a_vehicle_that_mocap_never_saw_raises_nothing(state: str) -> None:
    flight, time_s = STATES[state]
    unseen = np.full(3, np.nan)
    for is_armed, mode in itertools.product((False, True), FlightMode):
        seen = facts(time_s + 1.0, armed=is_armed, mode=mode, climb_mps=np.nan)
        advance(flight, replace(seen, position_w_m=unseen, velocity_w_mps=unseen), RULES)


@EVERY_STATE
def test_an_action_is_set_for_one_tick_and_no_request_repeats_it(state: str) -> None:
    """The loop begins a call on every flight handed to it whose action is set."""
    flight, time_s = STATES[state]
    pending = replace(flight, action=Action.DISARM)
    assert advance(pending, usual(state), RULES).action is not Action.DISARM
    for wanted in REQUESTS:
        after = apply_request(pending, wanted, facts(time_s, 1.0), RULES)
        assert after is pending or after.action is not Action.DISARM, wanted


# --- what ends a flight ---


@pytest.mark.parametrize("state", COMMANDED)
def test_who_disarms_ends_the_flight(state: str) -> None:
    flight = STATES[state][0]
    after = advance(flight, replace(usual(state), armed=False), RULES)
    assert end_of(after) == (Phase.DISARMED, None)
    assert not after.airborne
    assert after.reason == flight.reason


@pytest.mark.parametrize("state", IN_THE_AIR)
def test_who_disarms_in_the_air_is_told_of(state: str) -> None:
    seen = replace(usual(state), armed=False, events=(event(Fault.AUTOPILOT_DISARMED, "disarmed"),))
    after = advance(STATES[state][0], seen, RULES)
    assert end_of(after) == (Phase.DISARMED, None)
    assert after.reason.endswith("disarmed")


@pytest.mark.parametrize("state", ["touched down", "stopping"])
def test_what_disarming_makes_the_autopilot_show_is_no_fault(state: str) -> None:
    seen = with_faults(usual(state), Fault.AUTOPILOT_DISARMED, Fault.MODE_CHANGED, Fault.ROOM_LEFT)
    after = advance(STATES[state][0], replace(seen, armed=False, mode=FlightMode.HOLD), RULES)
    assert end_of(after) == (Phase.DISARMED, None)
    assert after.reason == STATES[state][0].reason


# --- handing over and taking back ---


def test_a_hand_over_asks_for_the_autopilots_landing_and_again_while_offboard_shows() -> None:
    flight, time_s = STATES["handed over"]
    assert (flight.action, flight.level, flight.reason) == (
        Action.AUTOPILOT_LAND,
        FailsafeAction.AUTOPILOT_LAND,
        "it broke",
    )
    asked_s = []
    for n in range(1, 500):
        flight = advance(flight, facts(time_s + n * DT_S, 1.0), RULES)
        asked_s += [n * DT_S] if flight.action is Action.AUTOPILOT_LAND else []
    assert asked_s == pytest.approx([RULES.land_again_s, 2.0 * RULES.land_again_s], abs=2 * DT_S)
    obeyed = advance(flight, facts(time_s + 50.0, 1.0, mode=FlightMode.LAND), RULES)
    assert end_of(obeyed) == (Phase.HANDED_OVER, None)
    over = advance(obeyed, facts(time_s + 60.0, armed=False, mode=FlightMode.LAND), RULES)
    assert (over.phase, over.reason) == (Phase.DISARMED, "it broke")


@pytest.mark.parametrize("state", ["tracking", "held by a fault"])
def test_a_hand_over_keeps_the_first_cause(state: str) -> None:
    flight, time_s = STATES[state]
    after = apply_request(flight, HandOverRequest("the service was closed"), facts(time_s, 1.0), RULES)
    before = f"{flight.reason}; then " if flight.reason else ""
    assert after.reason == f"{before}the service was closed"
    assert after.cause is None, "no fault of the table"
    assert after.landing_asked_s == time_s


def test_only_a_hand_over_that_asks_to_land_is_waited_for() -> None:
    assert STATES["let go"][0].landing_asked_s == math.inf
    assert replace(STATES["handed over"][0], phase=Phase.DISARMED).landing_asked_s == math.inf


def test_resume_begins_anew_and_hovers_where_the_vehicle_is_flown() -> None:
    flight, time_s = resuming()
    assert end_of(flight) == (Phase.RESUME, Action.OFFBOARD)
    assert (flight.yaw_rad, flight.since_s) == (0.3, time_s)
    np.testing.assert_array_equal(np.asarray(flight.ground_w_m), GROUND)
    assert (flight.level, flight.cause, flight.reason, flight.airborne) == (FailsafeAction.WARN, None, "", False)
    theirs = replace(facts(time_s + 1.0, 1.5, mode=FlightMode.POSITION), yaw_rad=-2.0)
    waiting = advance(flight, theirs, RULES)
    assert end_of(waiting) == (Phase.RESUME, None)
    assert state_machine.ground_thrust(waiting, time_s + 1.0, RULES) == RULES.hover_thrust
    back = replace(theirs, mode=FlightMode.OFFBOARD, velocity_w_mps=np.array([0.5, 0.0, 0.0]))
    ours = advance(waiting, back, RULES)
    assert (ours.phase, ours.airborne, ours.yaw_rad) == (Phase.HOLD, True, -2.0)
    reference = reference_at(ours, back.time_s)
    np.testing.assert_array_equal(reference.position_w_m, back.position_w_m)
    np.testing.assert_array_equal(reference.velocity_w_mps, back.velocity_w_mps)
    np.testing.assert_array_equal(reference.acceleration_w_mps2, np.zeros(3))
    assert reference.yaw_rad == -2.0
    landed, _ = until(apply_request(ours, LandRequest(), back, RULES), back.time_s, lambda now: now.touched_down)
    assert landed.ground_w_m is not None, "the ground is remembered from before"


def test_resume_is_given_up_when_offboard_does_not_show() -> None:
    flight, time_s = resuming()
    begun_s = time_s
    while flight.phase is Phase.RESUME:
        time_s += DT_S
        flight = advance(flight, facts(time_s, 1.0, mode=FlightMode.POSITION), RULES)
    assert end_of(flight) == (Phase.HANDED_OVER, None)
    assert time_s - begun_s == pytest.approx(RULES.resume_s, abs=2 * DT_S)
    assert (flight.level, flight.reason) == (FailsafeAction.RELEASE, "the autopilot did not show OFFBOARD")
    said = replace(
        facts(time_s, 1.0, mode=FlightMode.POSITION), text="Switching to Offboard is currently not available"
    )
    for text_s, words in ((begun_s, f": {said.text}"), (begun_s - 0.01, "")):
        late = advance(resuming()[0], replace(said, text_s=text_s), RULES)
        assert late.reason == f"the autopilot did not show OFFBOARD{words}"
    just = replace(resuming()[0], since_s=8.0)
    assert advance(just, facts(8.0 + RULES.resume_s, 1.0, mode=FlightMode.POSITION), RULES).phase is Phase.HANDED_OVER
    late = advance(flight, facts(time_s + DT_S, 1.0), RULES)
    assert late.action is Action.AUTOPILOT_LAND, "OFFBOARD shows after all: nobody flies"
    assert advance(late, facts(time_s + 2 * DT_S, 1.0), RULES).action is None


def test_a_vehicle_that_is_disarmed_while_it_is_wanted_back_has_ended_its_flight() -> None:
    flight, time_s = resuming()
    for mode in (FlightMode.POSITION, FlightMode.OFFBOARD):
        after = advance(flight, facts(time_s + DT_S, 1.0, armed=False, mode=mode), RULES)
        assert end_of(after) == (Phase.DISARMED, None)
        assert after.reason == "the vehicle was disarmed"


@pytest.mark.parametrize(
    ("mode", "action", "level"),
    [
        (FlightMode.POSITION, None, FailsafeAction.RELEASE),
        (FlightMode.OFFBOARD, Action.AUTOPILOT_LAND, FailsafeAction.AUTOPILOT_LAND),
    ],
)
def test_the_operator_who_no_longer_wants_it_back(
    mode: FlightMode, action: Action | None, level: FailsafeAction
) -> None:
    flight, time_s = resuming()
    for wanted in (LandRequest("operator aborts"), HandOverRequest("operator aborts")):
        after = apply_request(flight, wanted, facts(time_s, 1.0, mode=mode), RULES)
        assert (after.phase, after.action, after.level) == (Phase.HANDED_OVER, action, level)
        assert (after.reason, after.cause) == ("operator aborts", None)
    late = advance(after, facts(time_s + DT_S, 1.0), RULES)
    again = None if action is Action.AUTOPILOT_LAND else Action.AUTOPILOT_LAND
    assert late.action is again, "a service that closes leaves nobody in OFFBOARD"


@pytest.mark.parametrize("mode", list(FlightMode))
@pytest.mark.parametrize("state", ["handed over", "let go"])
def test_the_operator_may_have_px4_land_whoever_flies(state: str, mode: FlightMode) -> None:
    flight, time_s = STATES[state]
    asked = apply_request(flight, LandRequest("operator aborts"), facts(time_s + 5.0, 1.0, mode=mode), RULES)
    changed = replace(flight, action=Action.AUTOPILOT_LAND, command_sent_s=time_s + 5.0)
    assert bits(asked) == bits(changed), "the first reason stays"
    after = advance(asked, facts(time_s + 5.0 + DT_S, 1.0), RULES)
    assert after.action is None, "once, and again only while OFFBOARD shows"
    nameless = apply_request(
        replace(flight, reason=""), LandRequest("operator aborts"), facts(time_s + 5.0, 1.0), RULES
    )
    assert nameless.reason == "operator aborts"


@pytest.mark.parametrize("fault", list(Fault))
def test_nothing_is_begun_that_a_fault_would_end_at_once(fault: Fault) -> None:
    there = with_faults(facts(0.0, 1.0, mode=FlightMode.POSITION), fault)
    ends = state_machine.strongest(hovering()[0], there, RULES)[1] >= FailsafeAction.HOLD
    words = f"{fault} it is" if ends else ""
    assert refusal(STATES["handed over"][0], ResumeRequest(), there, RULES) == words
    leads_away = fault in {Fault.TRAFFIC, Fault.TRAFFIC_BLOCKED}  # which its own path shows
    assert refusal(STATES["hovering"][0], TrackRequest(CURVE, 1.0), there, RULES) == ("" if leads_away else words)
    assert refusal(STATES["armed"][0], TakeoffRequest(1.0), there, RULES) == words
    assert refusal(STATES["hovering"][0], LandRequest(), there, RULES) == "", "down is always allowed"


@pytest.mark.parametrize(
    ("height_m", "armed_now", "words"),
    [
        (1.0, False, "the vehicle is disarmed; run `companion arm` first"),
        (0.06, True, "the vehicle stands on the ground; run `companion disarm`"),
        (np.nan, True, "the vehicle stands on the ground; run `companion disarm`"),
        (0.07, True, ""),
    ],
)
def test_resume_wants_a_vehicle_in_the_air(height_m: float, armed_now: bool, words: str) -> None:
    seen = facts(9.0, height_m, armed=armed_now, mode=FlightMode.POSITION)
    assert refusal(STATES["let go"][0], ResumeRequest(), seen, RULES) == words


def test_a_vehicle_that_never_flew_is_not_resumed_into_the_air() -> None:
    for before in (preflight(), armed()):
        taken = advance(before, facts(0.2, 0.0, Fault.MODE_CHANGED, mode=FlightMode.POSITION), RULES)
        assert taken.phase is Phase.HANDED_OVER
        assert refusal(taken, ResumeRequest(), facts(0.3, 0.0, mode=FlightMode.POSITION), RULES) != ""


# --- kill ---


@EVERY_STATE
def test_kill_stops_the_motors_from_every_phase_and_asks_until_they_are(state: str) -> None:
    before, time_s = STATES[state]
    flight = apply_request(before, KillRequest(), facts(time_s, 1.0), RULES)
    assert end_of(flight) == (Phase.TERMINATED, Action.KILL)
    assert (flight.level, flight.cause, flight.airborne) == (FailsafeAction.TERMINATE, Fault.KILL, False)
    assert flight.reason.endswith("the operator stopped the motors")
    assert flight.reason.startswith(before.reason)
    asked_s = []
    for n in range(1, 101):
        flight = advance(flight, facts(time_s + n * DT_S, 1.0), RULES)
        asked_s += [n * DT_S] if flight.action is Action.KILL else []
    assert asked_s == pytest.approx([RULES.kill_again_s * k for k in (1, 2, 3)], abs=4 * DT_S)
    off = advance(flight, facts(time_s + 2.0, armed=False), RULES)
    assert end_of(off) == (Phase.TERMINATED, None)
    quick = replace(RULES, kill_again_s=0.5)
    assert advance(replace(flight, command_sent_s=8.0), facts(8.5), quick).action is Action.KILL


def test_an_arming_that_shows_after_the_kill_is_undone() -> None:
    flight = apply_request(preflight(), KillRequest(), facts(0.5, armed=False), RULES)
    flight = advance(flight, facts(0.5 + RULES.kill_settles_s, armed=False), RULES)
    assert advance(flight, facts(0.6 + RULES.kill_settles_s), RULES).action is Action.KILL


def test_whoever_arms_long_after_a_kill_keeps_his_motors() -> None:
    flight, time_s = STATES["terminated"]
    flight = advance(flight, facts(time_s + RULES.kill_settles_s + 0.01, armed=False), RULES)
    for later_s in (10.0, 100.0):
        flight = advance(flight, facts(time_s + later_s, 1.0, mode=FlightMode.POSITION), RULES)
        assert end_of(flight) == (Phase.TERMINATED, None)
    assert apply_request(flight, KillRequest(), facts(time_s + 200.0), RULES).action is Action.KILL, (
        "asked for is asked for"
    )


# --- on the ground ---


def test_arming_needs_offboard_too() -> None:
    for is_armed, mode in itertools.product((False, True), FlightMode):
        after = advance(preflight(), replace(facts(0.2, armed=is_armed, mode=mode), yaw_rad=0.7), RULES)
        ready = is_armed and mode is FlightMode.OFFBOARD
        assert after.phase is (Phase.ARMED if ready else Phase.PREFLIGHT)
        assert after.yaw_rad == 0.7, "the heading that is held is the one that is"
        assert after.since_s == (0.2 if ready else 0.0)


def test_prepare_begins_a_new_flight() -> None:
    ended, _ = STATES["terminated"]
    seen = replace(facts(50.0, armed=False), yaw_rad=1.0)
    anew = FlightState(phase=Phase.PREFLIGHT, since_s=50.0, yaw_rad=1.0, ground_w_m=seen.position_w_m)
    assert bits(apply_request(ended, ArmRequest(), seen, RULES)) == bits(anew)


@pytest.mark.parametrize("ask", [True, False], ids=["asked", "fault"])
def test_a_preparation_that_ends_just_as_the_motors_start_stops_them(ask: bool) -> None:
    both = facts(0.2, 0.0) if ask else facts(0.2, 0.0, Fault.MOCAP_SLOW)
    after = apply_request(preflight(), LandRequest(), both, RULES) if ask else advance(preflight(), both, RULES)
    assert (after.phase, after.touched_down) == (Phase.LAND, True), "or idling motors would be left to themselves"


@pytest.mark.parametrize(("is_armed", "mode"), [(True, FlightMode.POSITION), (False, FlightMode.OFFBOARD)])
def test_a_preparation_that_ends_leaves_a_pilots_motors_alone(is_armed: bool, mode: FlightMode) -> None:
    after = apply_request(preflight(), LandRequest(), facts(0.2, armed=is_armed, mode=mode), RULES)
    assert end_of(after) == (Phase.DISARMED, None)


def test_the_thrust_ramps_up_past_hover_and_is_zero_in_every_other_phase() -> None:
    flight = spooling()
    thrusts = [state_machine.ground_thrust(flight, 1.0 + 0.01 * n, RULES) for n in range(3000)]
    assert thrusts[0] == 0.0
    assert thrusts[100] == pytest.approx(RULES.hover_thrust * RULES.quick_ramp)
    assert thrusts[200] == pytest.approx(RULES.hover_thrust * (RULES.quick_ramp + RULES.slow_ramp_ps))
    assert thrusts[-1] == pytest.approx(RULES.hover_thrust * RULES.ramp_overshoot)
    slowly = replace(RULES, spool_up_s=4.0)
    assert state_machine.ground_thrust(flight, 3.0, slowly) == pytest.approx(
        0.5 * RULES.hover_thrust * RULES.quick_ramp
    )
    steps = np.diff(thrusts)
    assert np.all(steps >= 0.0)
    assert float(steps.max()) <= 0.01 * RULES.hover_thrust * 1.01, "no step of more than 1 % of hover a cycle"
    for state, (other, time_s) in STATES.items():
        if other.phase not in {Phase.TAKEOFF, Phase.RESUME}:
            assert state_machine.ground_thrust(other, time_s + 5.0, RULES) == 0.0, state


@pytest.mark.parametrize(
    ("height_m", "climb_mps", "airborne", "because"),
    [
        (0.019, 0.2, False, "less than lift_off_m"),
        (0.021, 0.2, True, "above it and rising"),
        (0.021, 0.0, False, "above it but not rising: a bump"),
        (0.021, -0.01, False, "above it but falling: a bump"),
    ],
)
def test_lift_off_is_seen_in_height_and_climb(height_m: float, climb_mps: float, airborne: bool, because: str) -> None:
    after = advance(spooling(), facts(2.0, height_m, climb_mps=climb_mps), RULES)
    assert after.airborne == airborne, because
    assert after.phase is Phase.TAKEOFF


def without_lift_off(in_air: bool | None) -> tuple[FlightState, float]:
    """The thrust's ramp while motion capture sees nothing move, until that ends; and when it does, s."""
    flight, time_s = spooling(), 1.0
    while flight.phase is Phase.TAKEOFF:
        time_s += 0.01
        assert time_s < 60.0, "it must give up some time"
        flight = advance(flight, replace(facts(time_s), in_air=in_air), RULES)
    return flight, time_s


@pytest.mark.parametrize("in_air", [True, None])
def test_no_lift_off_seen_of_a_vehicle_that_may_fly_is_px4s_to_land(in_air: bool | None) -> None:
    """Motion capture may look at another body: stopping the motors would let ours fall."""
    flight, time_s = without_lift_off(in_air)
    assert time_s - 1.0 == pytest.approx(1.0 + (1.25 - 0.8) / 0.15, abs=0.03), "at the ramp's end, no later"
    assert (flight.phase, flight.action) == (Phase.HANDED_OVER, Action.AUTOPILOT_LAND)
    assert (flight.cause, flight.level) == (Fault.LIFT_OFF_UNSEEN, FailsafeAction.AUTOPILOT_LAND)
    assert flight.reason == (
        "no lift-off seen at thrust 0.62, and PX4 does not say that it stands: check that QTM's body is the vehicle, "
        "vehicle.hover_thrust, propellers and battery"
    )


def test_no_lift_off_of_a_vehicle_that_stands_ends_the_attempt_with_a_sentence() -> None:
    flight, time_s = without_lift_off(in_air=False)
    assert time_s - 1.0 == pytest.approx(1.0 + (1.25 - 0.8) / 0.15 + 1.0, abs=0.03), "ramp and wait"
    assert flight.phase is Phase.LAND
    assert flight.touched_down
    assert flight.reason == "no lift-off at thrust 0.62: check vehicle.hover_thrust, propellers and battery"
    flight = advance(flight, replace(facts(time_s + 0.4), in_air=False), RULES)
    assert flight.action is Action.DISARM
    over = advance(flight, facts(time_s + 0.5, armed=False), RULES)
    assert over.phase is Phase.DISARMED
    assert over.reason.startswith("no lift-off"), "the reason outlives the disarming"


@pytest.mark.parametrize("state", ON_THE_GROUND)
def test_asked_to_land_on_the_ground_the_motors_stop_and_disarming_goes_on(state: str) -> None:
    flight, time_s = STATES[state]
    after = apply_request(flight, LandRequest(), facts(time_s, 0.0), RULES)
    assert (after.phase, after.touched_down, after.airborne) == (Phase.LAND, True, False)
    stands = [replace(facts(time_s + later_s), in_air=False) for later_s in (0.1, 0.5)]
    assert [advance(after, seen, RULES).action for seen in stands] == [None, Action.DISARM]


# --- whole flights ---


def test_a_flight_visits_its_phases_in_order_and_streams_until_it_is_disarmed() -> None:
    flight, time_s = spooling(), 1.0
    order = [flight.phase]
    airborne = []
    for n in range(9000):
        time_s += DT_S
        seen = on_reference(flight, time_s)
        if not flight.airborne and flight.phase is Phase.TAKEOFF:
            seen = facts(time_s, 0.03 * min(1.0, n / 150), climb_mps=0.1)
        if n == 1500:
            flight = apply_request(flight, TrackRequest(FigureEight(CENTRE), 1.0), seen, RULES)
        if n == 7000:
            flight = apply_request(flight, LandRequest(), replace(seen, arms_stowed=False), RULES)
            order.append(flight.phase)
        before, flight = flight, advance(flight, seen, RULES)
        order += [flight.phase] if flight.phase is not order[-1] else []
        airborne += [(flight.airborne, flight.phase)] if flight.airborne != before.airborne else []
        assert flight.phase in STREAMING
        if flight.action is Action.DISARM:
            break
    over = advance(flight, facts(time_s + DT_S, armed=False), RULES)
    expected = [Phase.TAKEOFF, Phase.HOLD, Phase.TRACK, Phase.HOLD, Phase.STOW, Phase.LAND]
    assert [*order, over.phase] == [*expected, Phase.DISARMED]
    assert airborne == [(True, Phase.TAKEOFF), (False, Phase.LAND)], "the law is started once and stopped once"
    assert (over.level, over.cause, over.reason) == (FailsafeAction.WARN, None, "")


def test_a_hold_that_a_fault_began_ends_when_the_operator_flies_on() -> None:
    flight, time_s = STATES["held by a fault"]
    assert flight.held_by_fault_since_s == time_s
    flight, time_s = until(flight, time_s, lambda now: reference_at(now, time_s + 5.0).velocity_w_mps @ [1, 1, 1] == 0)
    still = with_faults(on_reference(flight, time_s), Fault.FENCE_NEAR)
    assert apply_request(flight, TrackRequest(CURVE, 1.0), still, RULES) is flight, "not while it is still there"
    flown = apply_request(flight, TrackRequest(CURVE, 1.0), on_reference(flight, time_s), RULES)
    assert (flown.phase, flown.level, flown.cause, flown.reason) == (Phase.HOLD, FailsafeAction.WARN, None, "")
    assert flown.held_by_fault_since_s == math.inf
    again = advance(flown, with_faults(on_reference(flown, time_s + DT_S), Fault.FENCE_NEAR), RULES)
    assert again.held_by_fault_since_s == time_s + DT_S, "it is reacted to anew"


def test_a_hold_that_a_fault_began_lands_when_nobody_answers() -> None:
    flight, time_s = STATES["held by a fault"]
    asked = apply_request(flight, HoldRequest(), on_reference(flight, time_s + 10.0), RULES)
    assert asked.held_by_fault_since_s == time_s + 10.0, "an operator who answers has the whole time again"
    down = advance(flight, with_faults(on_reference(flight, time_s + 30.0), Fault.HOLD_TOO_LONG), RULES)
    assert (down.phase, down.level, down.cause) == (Phase.LAND, FailsafeAction.LAND, Fault.HOLD_TOO_LONG)
    assert down.reason == "fence near it is; then hold too long it is"


@pytest.mark.parametrize(("climbed_s", "phase"), [(0.1, Phase.LAND), (0.5, Phase.LAND), (2.5, Phase.HOLD)])
def test_a_takeoff_that_would_hold_just_above_the_ground_lands(climbed_s: float, phase: Phase) -> None:
    flight, _ = STATES["climbing"]
    seen = on_reference(flight, flight.leg_start_s + climbed_s)
    after = advance(flight, with_faults(seen, Fault.FENCE_NEAR), RULES)
    assert (after.phase, after.cause) == (phase, Fault.FENCE_NEAR)


def test_an_operators_own_hold_is_not_timed() -> None:
    flight, time_s = tracking()
    held = apply_request(flight, HoldRequest(), on_reference(flight, time_s), RULES)
    assert (held.phase, held.held_by_fault_since_s) == (Phase.HOLD, math.inf)
    down = apply_request(STATES["held by a fault"][0], LandRequest(), facts(21.0, 1.0), RULES)
    assert down.held_by_fault_since_s == math.inf, "a hold is over when the landing begins"


def test_a_landing_that_px4_refuses_ends_with_nothing_sent() -> None:
    flight, time_s = STATES["handed over"]
    after = advance(flight, facts(time_s + 3.1, 1.0, Fault.LAND_REFUSED), RULES)
    assert (after.phase, after.action, after.level) == (Phase.HANDED_OVER, None, FailsafeAction.RELEASE)
    assert after.reason == "it broke; then landing refused it is"
    assert after.landing_asked_s == math.inf


@pytest.mark.parametrize("reason", ["", "Ctrl-C"])
def test_the_words_of_who_asks_to_land_are_kept(reason: str) -> None:
    flight, time_s = STATES["tracking"]
    assert apply_request(flight, LandRequest(reason), on_reference(flight, time_s), RULES).reason == reason
    held, held_s = STATES["held by a fault"]
    assert apply_request(held, LandRequest(reason), on_reference(held, held_s), RULES).reason == held.reason


def test_ground_is_where_it_was_armed_and_where_it_took_off() -> None:
    np.testing.assert_array_equal(np.asarray(armed().ground_w_m), GROUND)
    moved = advance(preflight(), replace(facts(0.2), position_w_m=GROUND - 0.1), RULES)
    np.testing.assert_array_equal(np.asarray(moved.ground_w_m), GROUND - 0.1)
    carried = replace(facts(1.0), position_w_m=GROUND + 0.1)
    np.testing.assert_array_equal(
        np.asarray(apply_request(armed(), TakeoffRequest(1.2), carried, RULES).ground_w_m), GROUND + 0.1
    )
