"""The flight machine: every phase against every request and every combination of facts, and whole flights."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.control.reference import Ellipse, FigureEight, Trajectory
from companion.supervisor import phases
from companion.supervisor.flight import (
    Action,
    Facts,
    Flight,
    FlightRules,
    Fly,
    HandOver,
    Land,
    Phase,
    Prepare,
    Request,
    TakeOff,
)
from companion.supervisor.phases import advance, can, reference_at, request
from companion.types import FlightMode

RULES = FlightRules()
DT_S = 0.01
GROUND = np.array([1.0, 2.0, 0.1])
CENTRE = np.array([0.0, 0.0, 1.2])
CURVE: Trajectory = Ellipse(CENTRE)

BY_REQUEST: dict[type, dict[Phase, Phase]] = {
    Prepare: {
        Phase.STANDBY: Phase.PREFLIGHT,
        Phase.DISARMED: Phase.PREFLIGHT,
        Phase.PREFLIGHT: Phase.PREFLIGHT,
    },
    TakeOff: {Phase.ARMED: Phase.TAKEOFF},
    Fly: {Phase.HOLD: Phase.HOLD, Phase.TRACK: Phase.HOLD},
    Land: {
        Phase.PREFLIGHT: Phase.DISARMED,
        Phase.ARMED: Phase.LAND,
        Phase.TAKEOFF: Phase.LAND,
        Phase.HOLD: Phase.LAND,
        Phase.TRACK: Phase.LAND,
        Phase.STOW: Phase.STOW,
        Phase.LAND: Phase.LAND,
    },
    HandOver: dict.fromkeys(
        (Phase.ARMED, Phase.TAKEOFF, Phase.HOLD, Phase.TRACK, Phase.STOW, Phase.LAND), Phase.HANDED_OVER
    ),
}
"""All that a request may change; everything else is ignored."""

BY_FACTS: dict[Phase, set[Phase]] = {
    Phase.STANDBY: set(),
    Phase.PREFLIGHT: {Phase.ARMED, Phase.DISARMED},
    Phase.ARMED: {Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.TAKEOFF: {Phase.HOLD, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.HOLD: {Phase.TRACK, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.TRACK: {Phase.HOLD, Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.STOW: {Phase.LAND, Phase.DISARMED, Phase.HANDED_OVER},
    Phase.LAND: {Phase.DISARMED, Phase.HANDED_OVER},
    Phase.DISARMED: set(),
    Phase.HANDED_OVER: {Phase.DISARMED},
}
"""All that facts may change in one tick, besides staying."""

BROKEN = "left.elbow_pitch (servo 6): overload"
REQUESTS: list[Request] = [Prepare(), TakeOff(1.2), Fly(CURVE, 1.0), Land(), HandOver("it broke")]


def facts(
    time_s: float,
    height_m: float = 0.0,
    *,
    climb_mps: float = 0.0,
    mocap_age_s: float = 0.01,
    armed: bool = True,
    mode: FlightMode = FlightMode.OFFBOARD,
) -> Facts:
    position = GROUND + np.array([0.0, 0.0, height_m])
    return Facts(time_s, position, np.array([0.0, 0.0, climb_mps]), 0.3, mocap_age_s, armed, mode)


def until(
    flight: Flight, time_s: float, done: Callable[[Flight], bool], within_s: float = 60.0
) -> tuple[Flight, float]:
    """Tick with the vehicle exactly on its reference until `done`."""
    end_s = time_s + within_s
    while not done(flight):
        assert time_s < end_s, f"still {flight.phase} after {within_s} s"
        time_s += DT_S
        flight = advance(flight, on_reference(flight, time_s), RULES)
    return flight, time_s


def on_reference(flight: Flight, time_s: float) -> Facts:
    if not flight.airborne:
        return facts(time_s, 0.0)
    ref = reference_at(flight, time_s)
    at_ground = np.maximum(ref.position_w_m, [-np.inf, -np.inf, GROUND[2]])
    velocity = ref.velocity_w_mps if ref.position_w_m[2] >= GROUND[2] else np.zeros(3)
    return replace(facts(time_s), position_w_m=at_ground, velocity_w_mps=velocity)


def preflight() -> Flight:
    return request(Flight(), Prepare(), facts(0.0, armed=False), RULES)


def armed() -> Flight:
    return advance(preflight(), facts(0.1), RULES)


def spooling() -> Flight:
    return request(armed(), TakeOff(1.2), facts(1.0), RULES)


def climbing() -> Flight:
    return advance(spooling(), facts(2.5, 0.05, climb_mps=0.2), RULES)


def hovering() -> tuple[Flight, float]:
    return until(climbing(), 2.5, lambda flight: flight.phase is Phase.HOLD)


def approaching() -> tuple[Flight, float]:
    flight, time_s = hovering()
    return request(flight, Fly(CURVE, 1.0), on_reference(flight, time_s), RULES), time_s


def tracking() -> tuple[Flight, float]:
    flight, time_s = approaching()
    flight, time_s = until(flight, time_s, lambda now: now.phase is Phase.TRACK)
    for _ in range(500):  # 5 s on: at full speed
        time_s += DT_S
        flight = advance(flight, on_reference(flight, time_s), RULES)
    return flight, time_s


def descending() -> tuple[Flight, float]:
    flight, time_s = hovering()
    return request(flight, Land(), on_reference(flight, time_s), RULES), time_s


def stowing() -> tuple[Flight, float]:
    flight, time_s = tracking()
    return request(flight, Land(), replace(on_reference(flight, time_s), arms_stowed=False), RULES), time_s


def touched_down() -> tuple[Flight, float]:
    flight, time_s = descending()
    return until(flight, time_s, lambda now: now.touched_down)


def given_up() -> tuple[Flight, float]:
    flight, time_s = hovering()
    return request(flight, HandOver("it broke"), on_reference(flight, time_s), RULES), time_s


STATES: dict[str, tuple[Flight, float]] = {
    "standby": (Flight(), 0.0),
    "preflight": (preflight(), 0.1),
    "armed": (armed(), 0.5),
    "spooling up": (spooling(), 1.5),
    "climbing": (climbing(), 3.0),
    "hovering": hovering(),
    "approaching": approaching(),
    "tracking": tracking(),
    "stowing": stowing(),
    "descending": descending(),
    "touched down": touched_down(),
    "disarmed": (request(preflight(), Land(), facts(0.2), RULES), 0.3),
    "handed over": given_up(),
}
EVERY_STATE = pytest.mark.parametrize("state", STATES)
IN_THE_AIR = ["climbing", "hovering", "approaching", "tracking", "stowing", "descending"]
COMMANDED = ["armed", "spooling up", *IN_THE_AIR, "touched down"]


def test_the_states_tried_cover_every_phase() -> None:
    assert {flight.phase for flight, _ in STATES.values()} == set(Phase)


@EVERY_STATE
@pytest.mark.parametrize("wanted", REQUESTS, ids=lambda wanted: type(wanted).__name__)
def test_a_request_does_what_the_table_says_and_nothing_else(state: str, wanted: Request) -> None:
    flight, time_s = STATES[state]
    table = BY_REQUEST[type(wanted)]
    assert can(flight, wanted) == (flight.phase in table)
    after = request(flight, wanted, facts(time_s, 1.0), RULES)
    if flight.phase in table:
        assert after.phase is table[flight.phase]
    else:
        assert after is flight, f"{type(wanted).__name__} does not fit {flight.phase} and must be ignored"


@EVERY_STATE
@pytest.mark.parametrize("mode", list(FlightMode))
def test_no_combination_of_facts_raises_or_leads_off_the_table(state: str, mode: FlightMode) -> None:
    flight, time_s = STATES[state]
    for is_armed, age_s, height_m, climb_mps, later_s in itertools.product(
        (False, True), (0.01, 0.29, 0.31, float("inf")), (-0.2, 0.0, 0.05, 1.2), (-0.3, 0.0, 0.3), (0.01, 1.0, 100.0)
    ):
        clear = facts(time_s + later_s, height_m, climb_mps=climb_mps, mocap_age_s=age_s, armed=is_armed, mode=mode)
        for seen in (clear, replace(clear, arms_stowed=False), replace(clear, arms_stowed=False, arm_fault=BROKEN)):
            after = advance(flight, seen, RULES)
            allowed = BY_FACTS[flight.phase] | {flight.phase}
            assert after.phase in allowed, f"{flight.phase} -> {after.phase} on {seen}"
            if after.airborne:
                reference = reference_at(after, seen.time_s)
                assert np.all(np.isfinite(reference.position_w_m))


@EVERY_STATE
def test_a_vehicle_that_mocap_never_saw_raises_nothing(state: str) -> None:
    flight, time_s = STATES[state]
    unseen = np.full(3, np.nan)
    for is_armed, mode in itertools.product((False, True), FlightMode):
        advance(flight, Facts(time_s + 1.0, unseen, unseen, 0.0, float("inf"), is_armed, mode), RULES)


# --- what ends a flight ---


@pytest.mark.parametrize("state", COMMANDED)
@pytest.mark.parametrize("mode", [mode for mode in FlightMode if mode is not FlightMode.OFFBOARD])
def test_a_pilot_who_takes_the_mode_gets_the_vehicle_and_no_more_is_asked(state: str, mode: FlightMode) -> None:
    flight, time_s = STATES[state]
    after = advance(flight, facts(time_s + DT_S, 1.0, mode=mode), RULES)
    assert after.phase is Phase.HANDED_OVER
    assert after.action is None, "the pilot decides, not we"
    assert after.reason == f"the autopilot left OFFBOARD for {mode}"
    assert not after.airborne
    later = advance(after, facts(time_s + 1.0, 1.0), RULES)
    assert later.phase is Phase.HANDED_OVER, "OFFBOARD again is no invitation"
    over = advance(later, facts(time_s + 2.0, armed=False, mode=mode), RULES)
    assert over.phase is Phase.DISARMED
    assert over.reason == after.reason


@pytest.mark.parametrize("state", COMMANDED)
def test_who_disarms_ends_the_flight(state: str) -> None:
    flight, time_s = STATES[state]
    after = advance(flight, facts(time_s + DT_S, 1.0, armed=False), RULES)
    assert after.phase is Phase.DISARMED
    assert after.action is None
    assert ("disarmed in the air" in after.reason) == (state in IN_THE_AIR)


@pytest.mark.parametrize(
    ("state", "phase", "action"),
    [
        ("standby", Phase.STANDBY, None),
        ("preflight", Phase.DISARMED, None),
        ("armed", Phase.LAND, None),
        ("spooling up", Phase.HANDED_OVER, Action.AUTOPILOT_LAND),
        *((state, Phase.HANDED_OVER, Action.AUTOPILOT_LAND) for state in IN_THE_AIR),
        ("disarmed", Phase.DISARMED, None),
        ("handed over", Phase.HANDED_OVER, None),
    ],
)
def test_what_mocap_silence_does(state: str, phase: Phase, action: Action | None) -> None:
    flight, time_s = STATES[state]
    still = advance(flight, facts(time_s + DT_S, 1.0, mocap_age_s=0.3), RULES)
    assert still.phase is not Phase.HANDED_OVER or flight.phase is Phase.HANDED_OVER, "0.3 s is still allowed"
    after = advance(flight, facts(time_s + DT_S, 1.0, mocap_age_s=0.301), RULES)
    assert (after.phase, after.action) == (phase, action)
    if after.phase is not flight.phase:
        assert after.reason == "motion capture has been silent for 0.30 s"
    assert advance(after, facts(time_s + 2 * DT_S, 1.0, mocap_age_s=0.311), RULES).action is not Action.AUTOPILOT_LAND


@pytest.mark.parametrize("state", ["armed", "touched down"])
def test_on_the_ground_silence_still_ends_in_disarming_exactly_once(state: str) -> None:
    flight, time_s = STATES[state]
    asked = []
    for n in range(100):
        flight = advance(flight, facts(time_s + DT_S * (n + 1), mocap_age_s=1.0), RULES)
        asked.append(flight.action)
    assert asked.count(Action.DISARM) == 1
    assert asked.count(Action.AUTOPILOT_LAND) == 0


def test_after_touchdown_the_configured_wait_counts_in_silence_too() -> None:
    flight, time_s = STATES["touched down"]
    slow = replace(RULES, touchdown_s=2.0)
    blind = advance(flight, facts(time_s + 1.5, mocap_age_s=1.0), slow)
    assert blind.action is None
    assert advance(flight, facts(time_s + 2.1, mocap_age_s=1.0), slow).action is Action.DISARM


def test_a_hand_over_asks_for_the_autopilots_landing_once() -> None:
    flight, time_s = STATES["handed over"]
    assert flight.action is Action.AUTOPILOT_LAND
    assert flight.reason == "it broke"
    assert advance(flight, facts(time_s + DT_S, 1.0), RULES).action is None


# --- the arms ---


@pytest.mark.parametrize(
    ("state", "phase"),
    [
        ("standby", Phase.STANDBY),
        ("preflight", Phase.DISARMED),
        ("armed", Phase.LAND),
        ("spooling up", Phase.LAND),
        ("climbing", Phase.LAND),
        ("hovering", Phase.LAND),
        ("approaching", Phase.LAND),
        ("tracking", Phase.LAND),
        ("stowing", Phase.LAND),
        ("descending", Phase.LAND),
        ("touched down", Phase.LAND),
        ("disarmed", Phase.DISARMED),
        ("handed over", Phase.HANDED_OVER),
    ],
)
def test_what_a_servo_fault_does(state: str, phase: Phase) -> None:
    flight, time_s = STATES[state]
    broken = replace(facts(time_s + DT_S, 1.0), arms_stowed=False, arm_fault=BROKEN)
    after = advance(flight, broken, RULES)
    assert after.phase is phase
    if after.phase is not flight.phase:
        assert after.reason == BROKEN
        assert after.airborne == flight.airborne
        jump = reference_at(after, broken.time_s).position_w_m if after.airborne else GROUND
        before = reference_at(flight, broken.time_s).position_w_m if flight.airborne else GROUND
        assert jump == pytest.approx(before), "the reference goes on from where it was"


@pytest.mark.parametrize("state", ["climbing", "hovering", "tracking"])
def test_a_servo_fault_may_be_told_not_to_end_the_flight(state: str) -> None:
    flight, time_s = STATES[state]
    broken = replace(facts(time_s + DT_S, 1.0), arm_fault=BROKEN)
    after = advance(flight, broken, replace(RULES, land_on_arm_fault=False))
    assert after.phase is flight.phase


def test_landing_waits_at_rest_until_the_arms_are_stowed() -> None:
    flight, time_s = STATES["stowing"]
    last = reference_at(STATES["tracking"][0], time_s)
    assert reference_at(flight, time_s).velocity_w_mps == pytest.approx(last.velocity_w_mps)
    while time_s < flight.since_s + 4.0:
        time_s += DT_S
        flight = advance(flight, replace(on_reference(flight, time_s), arms_stowed=False), RULES)
    assert flight.phase is Phase.STOW
    hover = reference_at(flight, time_s)
    assert hover.velocity_w_mps == pytest.approx(np.zeros(3))
    landing = advance(flight, replace(on_reference(flight, time_s + DT_S), arms_stowed=True), RULES)
    assert (landing.phase, landing.reason) == (Phase.LAND, "")


def test_arms_that_do_not_stow_are_not_waited_for_for_ever() -> None:
    flight, time_s = STATES["stowing"]
    begun_s = flight.since_s
    while flight.phase is Phase.STOW:
        time_s += DT_S
        flight = advance(flight, replace(on_reference(flight, time_s), arms_stowed=False), RULES)
    assert flight.phase is Phase.LAND
    assert time_s - begun_s == pytest.approx(RULES.stow_time_s, abs=2 * DT_S)
    assert flight.reason == "the arms were not stowed in time"


# --- on the ground ---


def test_arming_needs_offboard_too() -> None:
    for is_armed, mode in itertools.product((False, True), FlightMode):
        after = advance(preflight(), facts(0.2, armed=is_armed, mode=mode), RULES)
        ready = is_armed and mode is FlightMode.OFFBOARD
        assert after.phase is (Phase.ARMED if ready else Phase.PREFLIGHT)


def test_the_thrust_ramps_up_past_hover_and_is_zero_in_every_other_phase() -> None:
    flight = spooling()
    thrusts = [phases.ground_thrust(flight, 1.0 + 0.01 * n, RULES) for n in range(3000)]
    assert thrusts[0] == 0.0
    assert thrusts[-1] == pytest.approx(RULES.hover_thrust * RULES.ramp_overshoot)
    steps = np.diff(thrusts)
    assert np.all(steps >= 0.0)
    assert float(steps.max()) <= 0.01 * RULES.hover_thrust * 1.01, "no step of more than 1 % of hover a cycle"
    for state, (other, time_s) in STATES.items():
        if other.phase is not Phase.TAKEOFF:
            assert phases.ground_thrust(other, time_s + 5.0, RULES) == 0.0, state


@pytest.mark.parametrize(
    ("height_m", "climb_mps", "airborne", "because"),
    [
        (0.019, 0.2, False, "less than lift_off_m"),
        (0.021, 0.2, True, "above it and rising"),
        (0.021, -0.01, False, "above it but falling: a bump"),
    ],
)
def test_lift_off_is_seen_in_height_and_climb(height_m: float, climb_mps: float, airborne: bool, because: str) -> None:
    after = advance(spooling(), facts(2.0, height_m, climb_mps=climb_mps), RULES)
    assert after.airborne == airborne, because
    assert after.phase is Phase.TAKEOFF


def test_the_law_is_started_at_lift_off_and_stopped_at_touchdown_and_nowhere_else() -> None:
    """`airborne` is what the flight loop starts the law afresh on: it must rise once and fall once in a flight."""
    flight, time_s = spooling(), 1.0
    changes = []
    for n in range(6000):
        time_s += DT_S
        seen = (
            on_reference(flight, time_s) if flight.airborne else facts(time_s, 0.03 * min(1.0, n / 150), climb_mps=0.1)
        )
        if n == 1500:
            flight = request(flight, Fly(FigureEight(CENTRE), 1.0), seen, RULES)
        if n == 4200:
            flight = request(flight, Land(), seen, RULES)
        after = advance(flight, seen, RULES)
        if after.airborne != flight.airborne:
            changes.append((after.airborne, after.phase))
        flight = after
        if flight.touched_down:
            break
    assert changes == [(True, Phase.TAKEOFF), (False, Phase.LAND)]


def test_no_lift_off_ends_the_attempt_with_a_sentence() -> None:
    flight, time_s = spooling(), 1.0
    while flight.phase is Phase.TAKEOFF:
        time_s += 0.1
        assert time_s < 60.0, "it must give up some time"
        flight = advance(flight, facts(time_s), RULES)
    assert flight.phase is Phase.LAND
    assert flight.touched_down
    assert flight.reason == "no lift-off at thrust 0.62: check vehicle.hover_thrust, propellers and battery"
    flight = advance(flight, facts(time_s + 0.4), RULES)
    assert flight.action is Action.DISARM
    over = advance(flight, facts(time_s + 0.5, armed=False), RULES)
    assert over.phase is Phase.DISARMED
    assert over.reason.startswith("no lift-off"), "the reason outlives the disarming"


# --- touchdown ---


def test_touchdown_asks_to_disarm_exactly_once() -> None:
    flight, time_s = STATES["touched down"]
    assert flight.phase is Phase.LAND
    actions = []
    for _ in range(500):
        time_s += DT_S
        flight = advance(flight, facts(time_s), RULES)
        actions.append(flight.action)
    assert actions.count(Action.DISARM) == 1
    assert actions.index(Action.DISARM) * DT_S == pytest.approx(RULES.touchdown_s, abs=2 * DT_S)
    over = advance(flight, facts(time_s + DT_S, armed=False), RULES)
    assert (over.phase, over.reason) == (Phase.DISARMED, "")


@pytest.mark.parametrize(
    ("height_m", "climb_mps", "because"),
    [(0.07, 0.0, "too high"), (0.0, -0.1, "still falling"), (0.0, 0.1, "bouncing up")],
)
def test_what_is_not_low_and_slow_is_no_touchdown(height_m: float, climb_mps: float, because: str) -> None:
    flight, time_s = descending()
    while reference_at(flight, time_s).position_w_m[2] > GROUND[2] + height_m - RULES.stuck_below_m:
        time_s += DT_S
        flight = advance(flight, facts(time_s, height_m, climb_mps=climb_mps), RULES)
    assert not flight.touched_down, because


def test_who_stands_on_hanging_arms_or_a_crate_has_landed_too() -> None:
    flight, time_s = descending()
    begun_s = time_s
    while not flight.touched_down:
        time_s += DT_S
        assert time_s < begun_s + 20.0, "the motors would run for ever"
        reference = reference_at(flight, time_s).position_w_m[2] - GROUND[2]
        flight = advance(flight, facts(time_s, max(0.35, float(reference))), RULES)
    below_m = 0.35 - float(reference_at(flight, time_s).position_w_m[2] - GROUND[2])
    assert below_m == pytest.approx(RULES.stuck_below_m + RULES.stuck_s * RULES.descent_speed_mps, abs=0.02)


@pytest.mark.parametrize("climb_mps", [-0.1, 0.1])
def test_who_moves_is_not_standing_however_far_the_reference_is_below(climb_mps: float) -> None:
    flight, time_s = descending()
    for n in range(2000):
        flight = advance(flight, facts(time_s + n * DT_S, 0.3, climb_mps=climb_mps), RULES)
    assert not flight.touched_down


def test_a_landing_is_not_held_up_by_arms_that_cannot_be_stowed() -> None:
    flight, time_s = STATES["stowing"]
    stuck = replace(on_reference(flight, time_s), arms_stowed=False, cannot_stow="the arms cannot be stowed: a cable")
    landing = advance(flight, stuck, RULES)
    assert (landing.phase, landing.reason) == (Phase.LAND, "the arms cannot be stowed: a cable")


def test_low_and_slow_is_no_touchdown_while_the_reference_is_still_above() -> None:
    """The vehicle is asked to be higher than it is: it will climb, so the motors must go on."""
    flight, time_s = descending()
    for n in range(100):  # the reference is still more than 0.9 m up
        flight = advance(flight, facts(time_s + n * DT_S, 0.0), RULES)
    assert not flight.touched_down


def test_a_landing_that_is_disturbed_begins_to_wait_anew() -> None:
    flight, time_s = descending()
    time_s += 20.0  # the reference is far below the ground by now
    for n in range(200):
        bump = 0.2 if n % 25 == 0 else 0.0
        flight = advance(flight, facts(time_s + n * DT_S, climb_mps=bump), RULES)
    assert not flight.touched_down, "0.25 s of rest at a time is less than touchdown_s"


# --- references ---


def check_continuous(flight: Flight, from_s: float, for_s: float) -> None:
    """No step in position or velocity over all legs, including the ends."""
    h = 0.002
    times = np.arange(from_s, from_s + for_s, h)
    p = np.array([reference_at(flight, float(t)).position_w_m for t in times])
    v = np.array([reference_at(flight, float(t)).velocity_w_mps for t in times])
    assert float(np.abs(np.diff(p, axis=0)).max()) < 2.0 * h * 1.5
    assert float(np.abs(np.diff(v, axis=0)).max()) < 2.0 * h * 4.0
    np.testing.assert_allclose((p[2:] - p[:-2]) / (2 * h), v[1:-1], atol=0.02)


@pytest.mark.parametrize("trajectory", [CURVE, FigureEight(CENTRE)], ids=["ellipse", "eight"])
@pytest.mark.parametrize("state", ["hovering", "approaching", "tracking"])
def test_the_reference_is_continuous_over_the_legs(state: str, trajectory: Trajectory) -> None:
    flight, time_s = STATES[state]
    before = reference_at(flight, time_s)
    flown = request(flight, Fly(trajectory, 1.0), on_reference(flight, time_s), RULES)
    after = reference_at(flown, time_s)
    np.testing.assert_allclose(after.position_w_m, before.position_w_m, atol=1e-9)
    np.testing.assert_allclose(after.velocity_w_mps, before.velocity_w_mps, atol=1e-9)
    np.testing.assert_allclose(after.acceleration_w_mps2, before.acceleration_w_mps2, atol=1e-9)
    check_continuous(flown, time_s, sum(min(leg.trajectory.duration_s, 40.0) for leg in flown.legs) + 1.0)


@pytest.mark.parametrize("state", IN_THE_AIR)
def test_landing_takes_over_the_motion(state: str) -> None:
    flight, time_s = STATES[state]
    before = reference_at(flight, time_s)
    down = request(flight, Land(), on_reference(flight, time_s), RULES)
    after = reference_at(down, time_s)
    np.testing.assert_allclose(after.position_w_m, before.position_w_m, atol=1e-9)
    np.testing.assert_allclose(after.velocity_w_mps, before.velocity_w_mps, atol=1e-9)
    assert after.yaw_rad == before.yaw_rad
    check_continuous(down, time_s, 5.0)


@settings(deadline=None)
@given(late_s=st.floats(0.0, 60.0))
def test_a_late_tick_does_not_shift_the_reference(late_s: float) -> None:
    """Legs begin when the last one ended, not when somebody looked."""
    flight, time_s = approaching()
    seen_s = time_s + late_s
    expected = reference_at(flight, seen_s)
    for _ in range(5):
        flight = advance(flight, facts(seen_s, 1.0), RULES)
    np.testing.assert_array_equal(reference_at(flight, seen_s).position_w_m, expected.position_w_m)


def test_a_flight_visits_its_phases_in_order() -> None:
    flight, time_s = approaching()
    order = [flight.phase]
    for _ in range(6000):
        time_s += DT_S
        flight = advance(flight, on_reference(flight, time_s), RULES)
        if flight.phase is not order[-1]:
            order.append(flight.phase)
    assert order == [Phase.HOLD, Phase.TRACK, Phase.HOLD]
    end = CURVE.at(CURVE.duration_s).position_w_m
    np.testing.assert_allclose(reference_at(flight, time_s).position_w_m, end, atol=1e-9)


def test_take_off_ends_above_where_it_stood() -> None:
    flight, time_s = STATES["hovering"]
    np.testing.assert_allclose(reference_at(flight, time_s).position_w_m, GROUND + np.array([0.0, 0.0, 1.2]))


def test_an_autopilot_that_stays_armed_after_touchdown_is_asked_again() -> None:
    flight, time_s = STATES["touched down"]
    asked_s = []
    for n in range(2000):
        flight = advance(flight, facts(time_s + n * DT_S), RULES)
        asked_s += [n * DT_S] if flight.action is Action.DISARM else []
    assert len(asked_s) > 1
    assert asked_s[1] - asked_s[0] == pytest.approx(RULES.disarm_again_s, abs=2 * DT_S)
