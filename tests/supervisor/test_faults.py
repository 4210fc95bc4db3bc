"""The table of faults, and that the machine carries it out: every state of a flight against every fault."""

import dataclasses
import itertools
import re
import string

import pytest

from companion.core.types import FlightMode
from companion.supervisor.faults import ROWS, TABLE, FailsafeAction, Fault, Row, Stage, reaction_to
from companion.supervisor.flight_state import STREAMING, Action, FlightState, KillRequest, Phase, ResumeRequest
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.state_machine import advance, strongest
from tests.supervisor.flown import (
    DT_S,
    IN_THE_AIR,
    ON_THE_GROUND,
    RULES,
    STATES,
    apply_request,
    bits,
    end_of,
    event,
    facts,
    usual,
    with_faults,
)

EVERY_FAULT = pytest.mark.parametrize("fault", list(Fault))
EVERY_STATE = pytest.mark.parametrize("state", STATES)
NUMBERS = {field.name: getattr(SafetyRules(), field.name) for field in dataclasses.fields(SafetyRules)}

# --- the table ---


def test_every_fault_has_exactly_one_row() -> None:
    assert [row.fault for row in TABLE] == list(Fault), "in the order of the list, too"
    assert list(ROWS.values()) == list(TABLE)
    assert all(ROWS[fault].fault is fault for fault in Fault)


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.fault)
def test_the_words_of_a_row_can_be_printed(row: Row) -> None:
    names = {name for _, name, _, _ in string.Formatter().parse(row.sign) if name is not None}
    assert names <= set(NUMBERS), "keys of SafetyRules"
    sign = row.sign.format(**NUMBERS)
    for words in (str(row.fault), sign, row.why):
        assert words == words.strip()
        assert len(words) > 3
        assert not words.endswith((".", ",", ";")), words
        assert not re.search(r"[{}]|  |\bnan\b|\binf\b", words), words
    assert row.why[0].islower() or row.why.startswith(("MAVSDK", "PX4")), row.why
    assert not re.search(r"\{", row.why), "numbers stand in the sign"


def test_every_number_of_the_safety_rules_is_explained_by_a_row() -> None:
    named = {name for row in TABLE for _, name, _, _ in string.Formatter().parse(row.sign) if name}
    used_inside = {"follow_radps", "follow_damping"}
    assert set(NUMBERS) - used_inside <= named


def test_the_words_of_the_reactions() -> None:
    words = ["warn", "disarm", "hold", "land", "PX4 lands", "release", "terminate"]
    assert [reaction.words for reaction in FailsafeAction] == words
    assert [int(reaction) for reaction in sorted(FailsafeAction)] == list(range(7))
    for left, right in itertools.pairwise(("WARN", "DISARM", "HOLD", "LAND", "AUTOPILOT_LAND", "RELEASE", "TERMINATE")):
        assert FailsafeAction[left] < FailsafeAction[right]


def test_the_table_answers_by_stage() -> None:
    for row in TABLE:
        assert {stage: reaction_to(row.fault, stage) for stage in Stage} == {
            Stage.GROUND: row.ground,
            Stage.FLYING: row.flying,
            Stage.LANDING: row.landing,
            Stage.HANDED_OVER: row.handed_over,
        }
    assert [str(stage) for stage in Stage] == ["ground", "flying", "landing", "handed over"]


@EVERY_FAULT
def test_reactions_are_sane(fault: Fault) -> None:
    row = ROWS[fault]
    ends = {FailsafeAction.AUTOPILOT_LAND, FailsafeAction.RELEASE, FailsafeAction.TERMINATE}
    assert row.flying is not FailsafeAction.DISARM, "motors do not stop in the air, unless they are killed"
    assert row.landing in {FailsafeAction.WARN, *ends}, "a landing is not held up, nor begun anew"
    assert row.landing == (row.flying if row.flying in ends else FailsafeAction.WARN), (
        "what ends a flight ends a landing"
    )
    assert row.ground in {
        FailsafeAction.WARN,
        FailsafeAction.DISARM,
        FailsafeAction.RELEASE,
        FailsafeAction.TERMINATE,
    }, "nobody lands there"
    assert row.handed_over in {FailsafeAction.WARN, FailsafeAction.RELEASE, FailsafeAction.TERMINATE}, (
        "somebody else flies it"
    )
    if row.flying > FailsafeAction.HOLD:
        never_there = {
            Fault.TRACKING_ERROR, Fault.TRACKING_LOST, Fault.THRUST_SATURATED, Fault.LANDING_TOO_LONG,
            Fault.HOLD_TOO_LONG, Fault.AUTOPILOT_DISARMED, Fault.TRAFFIC_BLOCKED,
        }  # fmt: skip
        assert row.ground > FailsafeAction.WARN or fault in never_there, "who would not fly on does not take off"


TERMINATING = {Fault.KILL, Fault.ROOM_LEFT}
ONLY_OURS = {Fault.HORIZON_LOST}
"""Begins with what is seen while we command it: the autopilot, landing by itself, is not stopped for it."""
LETTING_GO = {
    Fault.AUTOPILOT_SILENT, Fault.AUTOPILOT_REBOOTED, Fault.AUTOPILOT_DISARMED, Fault.MODE_CHANGED, Fault.LOOP_STOPPED,
}  # fmt: skip
BLIND = {
    Fault.MOCAP_SILENT, Fault.MOCAP_FROZEN, Fault.MOCAP_NAN, Fault.MOCAP_INVALID, Fault.MOCAP_OUTLIERS,
    Fault.MOCAP_JUMPED, Fault.MOCAP_CLOCK_JUMP, Fault.ATTITUDE_DISAGREES, Fault.HEADING_DISAGREES,
    Fault.LIFT_OFF_UNSEEN,
}  # fmt: skip


def test_motors_stop_in_the_air_for_kill_and_the_net_only() -> None:
    assert {row.fault for row in TABLE if row.flying is FailsafeAction.TERMINATE} == TERMINATING | ONLY_OURS
    assert {row.fault for row in TABLE if row.handed_over is FailsafeAction.TERMINATE} == TERMINATING
    assert {row.fault for row in TABLE if row.ground is FailsafeAction.TERMINATE} == {Fault.KILL}
    kill = ROWS[Fault.KILL]
    assert {kill.flying, kill.landing, kill.ground, kill.handed_over} == {FailsafeAction.TERMINATE}, "in every phase"


def test_who_loses_the_autopilot_lets_go_and_who_loses_sight_has_px4_land() -> None:
    """The estimate is PX4's in the second case; in the first it, or a pilot, has the vehicle already."""
    assert {row.fault for row in TABLE if row.flying is FailsafeAction.RELEASE} == LETTING_GO
    px4 = {row.fault for row in TABLE if row.flying is FailsafeAction.AUTOPILOT_LAND}
    assert px4 >= BLIND
    assert px4 - BLIND == {
        Fault.SETPOINT_NOT_FOLLOWED, Fault.TRACKING_LOST, Fault.FENCE_LEFT, Fault.LAW_FAILED, Fault.BATTERY_CRITICAL,
        Fault.LANDING_TOO_LONG, Fault.GROUND_LAW_SILENT, Fault.COMMAND_DELAYED,
    }  # fmt: skip


def test_a_stream_to_an_autopilot_that_is_gone_or_somebody_elses_ends_in_every_stage() -> None:
    """PX4 takes OFFBOARD up again by itself when setpoints come back."""
    gone = {Fault.AUTOPILOT_SILENT, Fault.LOOP_STOPPED}
    assert {row.fault for row in TABLE if row.ground is FailsafeAction.RELEASE} == {*gone, Fault.MODE_CHANGED}
    assert {row.fault for row in TABLE if row.handed_over is FailsafeAction.RELEASE} == {*gone, Fault.LAND_REFUSED}


@pytest.mark.parametrize(
    ("fault", "flying"),
    [
        (Fault.MOCAP_LATE, FailsafeAction.WARN),
        (Fault.MOCAP_DEGRADED, FailsafeAction.WARN),
        (Fault.LAND_REFUSED, FailsafeAction.WARN),
        (Fault.HORIZON_CAPPED, FailsafeAction.WARN),
        (Fault.OPERATOR_GONE, FailsafeAction.WARN),
        (Fault.DISK_FULL, FailsafeAction.WARN),
        (Fault.OFFBOARD_REFUSED, FailsafeAction.WARN),
        (Fault.SERVICE_TWICE, FailsafeAction.WARN),
        (Fault.FENCE_NEAR, FailsafeAction.HOLD),
        (Fault.MOCAP_SLOW, FailsafeAction.LAND),
        (Fault.MOCAP_DELAYED, FailsafeAction.LAND),
        (Fault.MOCAP_OUT_OF_ORDER, FailsafeAction.LAND),
        (Fault.HORIZON_WRONG, FailsafeAction.LAND),
        (Fault.TRACKING_ERROR, FailsafeAction.LAND),
        (Fault.THRUST_SATURATED, FailsafeAction.LAND),
        (Fault.LOOP_LATE, FailsafeAction.LAND),
        (Fault.BATTERY_LOW, FailsafeAction.LAND),
        (Fault.ARMS, FailsafeAction.LAND),
        (Fault.HOLD_TOO_LONG, FailsafeAction.LAND),
        (Fault.ABORT, FailsafeAction.LAND),
    ],
)
def test_what_is_not_that_bad(fault: Fault, flying: FailsafeAction) -> None:
    assert ROWS[fault].flying is flying


def test_what_does_not_hinder_a_take_off() -> None:
    """All else ends the preparation."""
    assert {row.fault for row in TABLE if row.ground is FailsafeAction.WARN} == {
        Fault.MOCAP_LATE, Fault.MOCAP_DEGRADED, Fault.TRACKING_ERROR, Fault.TRACKING_LOST, Fault.FENCE_NEAR,
        Fault.THRUST_SATURATED, Fault.AUTOPILOT_DISARMED, Fault.LAND_REFUSED, Fault.LANDING_TOO_LONG,
        Fault.HOLD_TOO_LONG, Fault.HORIZON_CAPPED, Fault.COMMAND_LATE, Fault.COMMANDS_REORDERED, Fault.COMMANDS_FOREIGN,
        Fault.GROUND_LAW_TWICE, Fault.TRAFFIC, Fault.TRAFFIC_BLOCKED, Fault.OTHER_UNSEEN,
    }  # fmt: skip


# --- and the machine ---

CARRIED_OUT: dict[FailsafeAction, tuple[Phase, Action | None]] = {
    FailsafeAction.DISARM: (Phase.LAND, None),
    FailsafeAction.HOLD: (Phase.HOLD, None),
    FailsafeAction.LAND: (Phase.LAND, None),
    FailsafeAction.AUTOPILOT_LAND: (Phase.HANDED_OVER, Action.AUTOPILOT_LAND),
    FailsafeAction.RELEASE: (Phase.HANDED_OVER, None),
    FailsafeAction.TERMINATE: (Phase.TERMINATED, Action.KILL),
}
"""With folded arms and an armed vehicle."""


def stage_of(state: str) -> Stage:
    """By the name of the state, not by the machine."""
    if state in {"handed over", "let go", "terminated"}:
        return Stage.HANDED_OVER
    if state in {"stowing", "descending", "landing by a fault"}:
        return Stage.LANDING
    return Stage.FLYING if state in {*IN_THE_AIR, "resuming"} else Stage.GROUND


def expected(state: str, flight: FlightState, reaction: FailsafeAction) -> tuple[Phase, Action | None] | None:
    """Return where the reaction leads; None: as if nothing were wrong."""
    if flight.phase in {Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED} or reaction <= flight.level:
        return None
    if reaction is FailsafeAction.DISARM and state in {"touched down", "stopping"}:
        return None
    if state == "preflight" and reaction in {FailsafeAction.DISARM, FailsafeAction.RELEASE}:
        return Phase.DISARMED, None
    if state == "resuming" and reaction is not FailsafeAction.TERMINATE:
        return CARRIED_OUT[FailsafeAction.RELEASE]
    return CARRIED_OUT[reaction]


@EVERY_STATE
def test_the_reaction_carried_out_is_the_tables(state: str) -> None:
    flight, seen = STATES[state][0], usual(state)
    for fault in Fault:
        reaction = ROWS[fault].reaction(stage_of(state))
        after = advance(flight, with_faults(seen, fault), RULES)
        outcome = expected(state, flight, reaction)
        if outcome is None:
            assert bits(after) == bits(advance(flight, seen, RULES)), f"{fault}: nothing of it changes"
            continue
        if state == "resuming" and fault is Fault.ROOM_LEFT:
            assert bits(after) == bits(advance(flight, seen, RULES)), "a pilot flies it still"
            continue
        assert end_of(after) == outcome, fault
        assert (after.cause, after.since_s) == (fault, seen.time_s)
        assert after.level == (
            FailsafeAction.RELEASE if state == "resuming" and reaction < FailsafeAction.RELEASE else reaction
        )
        assert after.reason == (f"{flight.reason}; then {fault} it is" if flight.reason else f"{fault} it is")
        assert after.airborne == (reaction in {FailsafeAction.HOLD, FailsafeAction.LAND} and state != "resuming")
        if after.phase is Phase.LAND:
            assert after.touched_down == (reaction is FailsafeAction.DISARM)


@EVERY_STATE
def test_no_second_fault_weakens_what_the_first_began_nor_does_the_first_begin_again(state: str) -> None:
    flight, seen, later = STATES[state][0], usual(state), usual(state, 2 * DT_S)
    began = {fault: advance(flight, with_faults(seen, fault), RULES) for fault in Fault}
    hit = [(fault, with_faults(later, fault)) for fault in Fault]
    for (first, begun), (second, seen_then) in itertools.product(began.items(), hit):
        after = advance(begun, seen_then, RULES)
        assert after.level >= begun.level
        if first is second:
            assert (after.level, after.reason, after.action) == (begun.level, begun.reason, None)
        if begun.phase not in STREAMING:
            assert after.phase not in STREAMING
        if begun.phase in {Phase.STOW, Phase.LAND}:
            assert after.phase not in {Phase.HOLD, Phase.TRACK, Phase.TAKEOFF}


@EVERY_STATE
def test_of_two_the_stronger_is_taken_and_the_first_of_equals(state: str) -> None:
    flight, seen = STATES[state][0], usual(state)
    alone = {fault: bits(advance(flight, with_faults(seen, fault), RULES)) for fault in Fault}
    for one, other in itertools.combinations(Fault, 2):
        told = [fault for fault in (one, other) if not (state == "resuming" and fault is Fault.ROOM_LEFT)]
        strong = max(told, key=lambda fault: ROWS[fault].reaction(stage_of(state)))
        assert bits(advance(flight, with_faults(seen, one, other), RULES)) == alone[strong], (one, other)


def test_the_strongest_is_told_with_its_words() -> None:
    hovering = STATES["hovering"][0]
    assert strongest(hovering, usual("hovering"), RULES) == (None, FailsafeAction.WARN)
    weak, strong = event(Fault.MOCAP_LATE), event(Fault.FENCE_NEAR, "0.10 m inside the fence")
    seen = dataclasses.replace(usual("hovering"), events=(weak, strong))
    assert strongest(hovering, seen, RULES) == (strong, FailsafeAction.HOLD)
    noted = dataclasses.replace(seen, events=(weak,))
    assert strongest(hovering, noted, RULES) == (None, FailsafeAction.WARN)


# --- the worst moments ---


@pytest.mark.parametrize("fault", sorted({row.fault for row in TABLE if row.ground <= FailsafeAction.DISARM}))
def test_whatever_ends_a_preparation_does_not_keep_a_landed_vehicle_from_being_disarmed(fault: Fault) -> None:
    for state in ("touched down", "stopping"):
        flight, time_s = STATES[state]
        asked_s = []
        for n in range(1, 200):
            flight = advance(flight, facts(time_s + n * DT_S, 0.0, fault), RULES)
            asked_s += [n * DT_S] if flight.action is Action.DISARM else []
        assert asked_s == pytest.approx([RULES.disarm_wait_unknown_s], abs=3 * DT_S)


@pytest.mark.parametrize("state", ON_THE_GROUND)
def test_a_vehicle_on_the_ground_whose_link_is_lost_or_mode_changed_is_left_to_the_other(state: str) -> None:
    """Also the stream ends: it would be taken up again when the link is back."""
    for fault in (Fault.AUTOPILOT_SILENT, Fault.MODE_CHANGED):
        after = advance(STATES[state][0], facts(30.0, 0.0, fault), RULES)
        assert (end_of(after), after.level) == ((Phase.HANDED_OVER, None), FailsafeAction.RELEASE)


@EVERY_FAULT
def test_a_fault_as_offboard_is_given_back_leaves_nobody_without_a_pilot(fault: Fault) -> None:
    """In OFFBOARD nobody flies but us: then PX4 lands, or its failsafe does when it cannot be told."""
    reaction = ROWS[fault].flying
    flight, time_s = STATES["resuming"]
    after = advance(flight, facts(time_s + DT_S, 1.0, fault), RULES)
    if reaction is FailsafeAction.WARN:
        assert after.phase is Phase.HOLD
        return
    taken = max(reaction, FailsafeAction.AUTOPILOT_LAND)
    assert (end_of(after), after.level) == (CARRIED_OUT[taken], taken)
    assert after.cause is fault


def test_a_fault_in_resume_asks_px4_to_land_once_a_late_offboard_shows() -> None:
    flight, time_s = STATES["resuming"]
    gone = advance(flight, facts(time_s + 0.1, 1.0, Fault.MOCAP_SLOW, mode=FlightMode.POSITION), RULES)
    assert (end_of(gone), gone.level) == ((Phase.HANDED_OVER, None), FailsafeAction.RELEASE)
    assert end_of(advance(gone, facts(time_s + 0.2, 1.0), RULES)) == (Phase.HANDED_OVER, Action.AUTOPILOT_LAND)


def test_a_link_lost_while_px4_is_told_to_land_ends_the_stream() -> None:
    flight, time_s = STATES["handed over"]
    assert flight.level is FailsafeAction.AUTOPILOT_LAND, "the level setpoint is still sent"
    after = advance(flight, facts(time_s + 0.6, 1.0, Fault.AUTOPILOT_SILENT), RULES)
    assert (after.phase, after.level, after.reason) == (
        Phase.HANDED_OVER, FailsafeAction.RELEASE, "it broke; then autopilot silent it is",
    )  # fmt: skip


def test_a_pose_that_jumps_while_the_rotors_spin_up_does_not_pass_for_a_lift_off() -> None:
    flight, time_s = STATES["spooling up"]
    seen = facts(time_s + DT_S, 0.8, Fault.MOCAP_JUMPED, climb_mps=0.5)
    after = advance(flight, seen, RULES)
    assert (after.phase, after.airborne, after.touched_down) == (Phase.LAND, False, True)


def test_escalation_all_the_way_tells_the_whole_story() -> None:
    flight, time_s = STATES["tracking"]
    story = [
        (Fault.FENCE_NEAR, Phase.HOLD),
        (Fault.BATTERY_LOW, Phase.LAND),
        (Fault.FENCE_LEFT, Phase.HANDED_OVER),
        (Fault.LAND_REFUSED, Phase.HANDED_OVER),
        (Fault.ROOM_LEFT, Phase.TERMINATED),
    ]
    levels = []
    for n, (fault, phase) in enumerate(story, 1):
        flight = advance(flight, facts(time_s + 0.1 * n, 1.0, fault), RULES)
        assert (flight.phase, flight.cause) == (phase, fault)
        levels.append(flight.level)
    assert levels == sorted(levels)
    assert levels[0] is FailsafeAction.HOLD
    assert flight.reason == (
        "fence near it is; then battery low it is; then fence left it is; then landing refused it is; "
        "then room left it is"
    )


BEGAN = {Fault.MODE_CHANGED, Fault.AUTOPILOT_SILENT, Fault.MOCAP_SILENT, Fault.BATTERY_CRITICAL}


@pytest.mark.parametrize("mode", list(FlightMode))
@pytest.mark.parametrize("began", sorted(BEGAN))
def test_a_pilots_motors_are_never_stopped_but_those_nobody_flies_are(began: Fault, mode: FlightMode) -> None:
    """Nobody's: in OFFBOARD, and in a landing of PX4's that no pilot has begun."""
    hovering, time_s = STATES["hovering"]
    gone = advance(hovering, facts(time_s + DT_S, 1.0, began, mode=mode), RULES)
    after = advance(gone, facts(time_s + 1.0, 1.0, Fault.ROOM_LEFT, mode=mode), RULES)
    nobodys = {FlightMode.OFFBOARD} if began is Fault.MODE_CHANGED else {FlightMode.OFFBOARD, FlightMode.LAND}
    assert (after.phase is Phase.TERMINATED) is (mode in nobodys)
    killed = apply_request(gone, KillRequest(), facts(time_s + 1.0, 1.0, mode=mode), RULES)
    assert killed.phase is Phase.TERMINATED, "the operator may"


def test_a_pilot_who_takes_it_out_of_px4s_landing_may_land_it_beyond_the_fence() -> None:
    flight, time_s = STATES["handed over"]
    modes = FlightMode.LAND, FlightMode.POSITION, FlightMode.LAND
    for n, mode in enumerate(modes, 1):
        assert not flight.theirs or n == len(modes)
        flight = advance(flight, facts(time_s + 0.1 * n, 1.0, mode=mode), RULES)
    beyond = facts(time_s + 1.0, 1.0, Fault.ROOM_LEFT, mode=FlightMode.LAND)
    assert advance(flight, beyond, RULES).phase is Phase.HANDED_OVER
    assert advance(flight, dataclasses.replace(beyond, mode=FlightMode.OFFBOARD), RULES).phase is Phase.TERMINATED
    resumed = apply_request(flight, ResumeRequest(), facts(time_s + 1.1, 1.0, mode=FlightMode.LAND), RULES)
    assert not resumed.theirs, "the operator's again"


def test_a_pilot_is_not_stopped_while_we_wait_for_offboard() -> None:
    flight, time_s = STATES["resuming"]
    beyond = facts(time_s + DT_S, 1.0, Fault.FENCE_LEFT, Fault.ROOM_LEFT, mode=FlightMode.POSITION)
    after = advance(flight, beyond, RULES)
    assert (end_of(after), after.cause) == ((Phase.HANDED_OVER, None), Fault.FENCE_LEFT)
    assert advance(flight, dataclasses.replace(beyond, mode=FlightMode.LAND), RULES).phase is Phase.TERMINATED
