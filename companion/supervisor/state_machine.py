"""Flight phases as a pure machine: facts and requests in, the next phase and its reference out.

What goes wrong comes as events; faults.TABLE says what follows, and the strongest reaction is taken, unless an equal or
stronger one was taken before. On the ground the law sleeps: it is started at lift-off, so nothing it integrates can
wind up against the floor.
"""

import math
from collections.abc import Callable
from dataclasses import replace

from companion.core.types import FlightMode
from companion.supervisor.faults import Event, FailsafeAction, Fault, Stage, reaction_to
from companion.supervisor.flight_state import (
    COMMANDED,
    STREAMING,
    Action,
    ArmRequest,
    FlightInputs,
    FlightRules,
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
from companion.supervisor.transitions import (
    approach,
    brake,
    descend,
    enter,
    give_back,
    ground_z_m,
    hand_over,
    land,
    lift_off,
    over,
    reacted,
    reference_at,
    resume,
    stop,
    then,
)

__all__ = ["advance", "ground_thrust", "reference_at", "refusal", "request", "strongest"]

_ALLOWED: dict[type, frozenset[Phase]] = {
    ArmRequest: frozenset({Phase.STANDBY, Phase.DISARMED, Phase.PREFLIGHT, Phase.TERMINATED}),
    TakeoffRequest: frozenset({Phase.ARMED}),
    TrackRequest: frozenset({Phase.HOLD, Phase.TRACK}),
    HoldRequest: frozenset({Phase.TAKEOFF, Phase.HOLD, Phase.TRACK}),
    LandRequest: STREAMING | {Phase.HANDED_OVER},
    HandOverRequest: COMMANDED | {Phase.RESUME},
    ResumeRequest: frozenset({Phase.HANDED_OVER}),
    KillRequest: frozenset(Phase),
}


def refusal(flight: FlightState, wanted: Request, facts: FlightInputs, rules: FlightRules) -> str:
    """Why a request cannot be met now; empty when it can."""
    if flight.phase not in _ALLOWED[type(wanted)]:
        return f"it does not fit phase {flight.phase}"
    if isinstance(wanted, HoldRequest) and not flight.airborne:
        return "the vehicle is not in the air"
    if isinstance(wanted, ResumeRequest) and not facts.armed:
        return "the vehicle is disarmed"
    if isinstance(wanted, ResumeRequest) and not facts.position_w_m[2] - ground_z_m(flight) > rules.touchdown_m:
        return "the vehicle stands on the ground"
    return (
        _in_the_way(flight, facts, rules) if isinstance(wanted, TakeoffRequest | TrackRequest | ResumeRequest) else ""
    )


def _in_the_way(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> str:
    """What is wrong now and would end at once what is asked for."""
    event, _ = strongest(replace(flight, phase=Phase.HOLD, airborne=True), facts, rules)
    return "" if event is None else event.text


def request(flight: FlightState, wanted: Request, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """Take an operator's request; what does not fit is ignored (the service refuses it before)."""
    if refusal(flight, wanted, facts, rules):
        return flight
    flight = replace(flight, action=None)
    if isinstance(wanted, HandOverRequest | KillRequest):
        return _given_up(flight, wanted, facts, rules)
    if isinstance(wanted, LandRequest):
        return _asked_to_land(replace(flight, reason=flight.reason or wanted.reason), facts, rules)
    if isinstance(wanted, TrackRequest):
        return approach(flight, wanted, facts, rules)
    if isinstance(wanted, HoldRequest):
        return brake(flight, facts, rules, Phase.HOLD)
    return _begun(flight, wanted, facts)


def _given_up(
    flight: FlightState, wanted: HandOverRequest | KillRequest, facts: FlightInputs, rules: FlightRules
) -> FlightState:
    """Another one brings it down."""
    if isinstance(wanted, HandOverRequest):
        flight = replace(flight, cause=None, reason=then(flight.reason, wanted.reason))
        if flight.phase is Phase.RESUME:
            return give_back(flight, facts)
        return replace(hand_over(flight, facts), level=FailsafeAction.AUTOPILOT_LAND)
    killed = Event(Fault.KILL, "the operator stopped the motors")
    return reacted(flight, facts, rules, killed, FailsafeAction.TERMINATE)


def _begun(
    flight: FlightState, wanted: ArmRequest | TakeoffRequest | ResumeRequest, facts: FlightInputs
) -> FlightState:
    """A phase that begins anew: on the ground, or with a vehicle somebody else has flown."""
    if isinstance(wanted, ArmRequest):
        return enter(FlightState(yaw_rad=facts.yaw_rad, ground_w_m=facts.position_w_m), Phase.PREFLIGHT, facts)
    if isinstance(wanted, TakeoffRequest):
        height_m = wanted.height_m
        return enter(flight, Phase.TAKEOFF, facts, ground_w_m=facts.position_w_m, takeoff_height_m=height_m)
    anew = FlightState(yaw_rad=facts.yaw_rad, ground_w_m=flight.ground_w_m)
    return replace(enter(anew, Phase.RESUME, facts), action=Action.OFFBOARD)


def _asked_to_land(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    if flight.phase is Phase.RESUME:
        return give_back(flight, facts)
    if flight.phase is Phase.HANDED_OVER:  # whoever has it: PX4 takes the operator's word as a pilot's
        return replace(flight, action=Action.AUTOPILOT_LAND, asked_again_s=facts.time_s)
    return flight if flight.phase in {Phase.STOW, Phase.LAND} else land(flight, facts, rules)


def advance(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """One tick: what the facts make of the phase."""
    flight = replace(flight, action=None) if flight.action else flight
    if flight.touched_down and flight.phase is Phase.LAND and not facts.armed:
        return over(flight, facts)  # as it should be: what disarming makes the autopilot show is no fault
    if flight.phase in STREAMING or flight.phase is Phase.HANDED_OVER:
        event, reaction = strongest(flight, facts, rules)
        stopping = flight.touched_down and reaction is FailsafeAction.DISARM
        if event is not None and reaction > flight.level and not stopping:
            return reacted(flight, facts, rules, event, reaction)
    if flight.phase in COMMANDED and not facts.armed:
        return over(flight, facts)
    step = _STEPS.get(flight.phase)
    return step(flight, facts, rules) if step else flight


def strongest(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> tuple[Event | None, FailsafeAction]:
    """The event with the strongest reaction in this stage, the first of the table among equals."""
    worst, most = None, FailsafeAction.WARN
    for event in facts.events:
        if event.fault is Fault.ARMS and not rules.land_on_arm_fault:
            continue
        if event.fault is Fault.ROOM_LEFT and _is_a_pilots(flight, facts):
            continue  # and so are the motors
        reaction = reaction_to(event.fault, flight.stage)
        if reaction > most:
            worst, most = event, reaction
    return worst, most


def _is_a_pilots(flight: FlightState, facts: FlightInputs) -> bool:
    """Not in OFFBOARD, which nobody flies, nor in PX4's landing or failsafe, unless a pilot had the vehicle before."""
    if flight.phase not in {Phase.HANDED_OVER, Phase.RESUME}:
        return False
    if facts.failsafe:
        return flight.theirs
    if facts.mode is FlightMode.OFFBOARD:
        return flight.theirs and facts.in_air is False  # landed and disarmed, see _handed_over
    return facts.mode is not FlightMode.LAND or flight.theirs or flight.cause is Fault.MODE_CHANGED


def ground_thrust(flight: FlightState, time_s: float, rules: FlightRules) -> float:
    """Thrust while the law sleeps: idle, ramping up, ramping down after touchdown, or hovering to take over."""
    if flight.phase is Phase.RESUME:
        return rules.hover_thrust
    since = time_s - flight.since_s
    if flight.phase is not Phase.TAKEOFF:
        return 0.0
    quick = rules.quick_ramp * since / rules.spool_up_s
    slow = rules.quick_ramp + rules.slow_ramp_ps * (since - rules.spool_up_s)
    return rules.hover_thrust * min(quick if since < rules.spool_up_s else slow, rules.ramp_overshoot)


def _ramp_time_s(rules: FlightRules) -> float:
    return rules.spool_up_s + (rules.ramp_overshoot - rules.quick_ramp) / rules.slow_ramp_ps


def _preflight(flight: FlightState, facts: FlightInputs, _: FlightRules) -> FlightState:
    flight = replace(flight, yaw_rad=facts.yaw_rad, ground_w_m=facts.position_w_m)
    ready = facts.armed and facts.mode is FlightMode.OFFBOARD
    return enter(flight, Phase.ARMED, facts) if ready else flight


def _takeoff(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    if flight.airborne:
        return _next_leg(flight, facts, rules)
    height_m = float(facts.position_w_m[2]) - ground_z_m(flight)
    if height_m > rules.lift_off_m and facts.velocity_w_mps[2] > 0.0:
        return lift_off(flight, facts, rules)
    return _no_lift_off(flight, facts, rules)


def _no_lift_off(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """End the attempt when the thrust should have lifted the vehicle; the motors stop only if PX4, too, says it stands.

    Motion capture may look at another body, while ours climbs without control.
    """
    waited_s, stands = facts.time_s - flight.since_s - _ramp_time_s(rules), facts.in_air is False
    if waited_s <= (rules.lift_off_wait_s if stands else 0.0):
        return flight
    thrust, check = rules.hover_thrust * rules.ramp_overshoot, "vehicle.hover_thrust, propellers and battery"
    if stands:
        return replace(stop(flight, facts), reason=f"no lift-off at thrust {thrust:.2f}: check {check}")
    why = f"no lift-off seen at thrust {thrust:.2f}, and PX4 does not say that it stands"
    event = Event(Fault.LIFT_OFF_UNSEEN, f"{why}: check that QTM's body is the vehicle, {check}")
    return reacted(flight, facts, rules, event, reaction_to(event.fault, Stage.FLYING))


def _next_leg(flight: FlightState, facts: FlightInputs, _: FlightRules) -> FlightState:
    """Go on to the next leg when the present one is flown; the last one is held."""
    if len(flight.legs) < 2 or facts.time_s < flight.leg_start_s + flight.legs[0].trajectory.duration_s:
        return flight
    start_s = flight.leg_start_s + flight.legs[0].trajectory.duration_s
    flight = replace(flight, legs=flight.legs[1:], leg_start_s=start_s)
    return flight if flight.legs[0].phase is flight.phase else enter(flight, flight.legs[0].phase, facts)


def _stowing(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """Wait for the arms; a fault or the time ends the waiting, and the arms' fault is the reason that is told."""
    late = facts.time_s - flight.since_s > rules.stow_time_s
    hindered = facts.arm_fault or facts.cannot_stow or ("the arms were not stowed in time" if late else "")
    if not (facts.arms_stowed or hindered):
        return _next_leg(flight, facts, rules)
    why = flight.reason or ("" if facts.arms_stowed else hindered)
    return replace(descend(flight, facts, rules), reason=why)


def _landing(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    if flight.touched_down:
        return _stopping(flight, facts, rules)
    low = facts.position_w_m[2] - ground_z_m(flight) < rules.touchdown_m
    slow = abs(float(facts.velocity_w_mps[2])) < rules.touchdown_speed_mps
    below_m = float(facts.position_w_m[2] - reference_at(flight, facts.time_s).position_w_m[2])
    standing = low and below_m > 0.0
    stuck = below_m > rules.stuck_below_m and _rests_on_something(facts, rules)
    if not slow or not (standing or stuck):
        return replace(flight, still_since_s=None)
    since = flight.still_since_s if flight.still_since_s is not None else facts.time_s
    if facts.time_s - since < (rules.touchdown_s if standing else rules.stuck_s):
        return replace(flight, still_since_s=since)
    return replace(
        flight, airborne=False, touched_down=True, since_s=facts.time_s, still_since_s=None, yaw_rad=facts.yaw_rad
    )


def _stopping(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """Ask to disarm when PX4 grants it: it refuses ("not landed") until its land detector has seen the landing."""
    if flight.disarm_asked_s is not None:
        due = facts.time_s - flight.disarm_asked_s > rules.disarm_again_s
    else:
        unknown_s, in_air_s = rules.disarm_wait_unknown_s, rules.disarm_wait_in_air_s
        wait_s = {None: unknown_s, True: in_air_s, False: rules.touchdown_s}[facts.in_air]
        due = facts.time_s - flight.since_s > wait_s
    return replace(flight, action=Action.DISARM, disarm_asked_s=facts.time_s) if due else flight


def _rests_on_something(facts: FlightInputs, rules: FlightRules) -> bool:
    """A vehicle that stays where it is in the air needs its hover thrust for that."""
    return facts.in_air is False or facts.thrust < rules.stuck_thrust * rules.hover_thrust


def _handed_over(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """Until it is down; OFFBOARD would mean that nobody flies it: the autopilot holds our last setpoint."""
    if not facts.armed:
        return over(flight, facts)
    if not flight.theirs and _is_a_pilots(flight, facts):
        flight = replace(flight, theirs=True)
    if facts.mode is not FlightMode.OFFBOARD:
        return replace(flight, left_offboard=True, offboard_again_s=math.inf)
    flight = _back_in_offboard(flight, facts)
    disarms = 0.0 <= facts.time_s - flight.offboard_again_s < rules.disarm_shows_s
    if disarms or facts.time_s - flight.asked_again_s < rules.land_again_s:
        return flight
    return replace(flight, action=Action.AUTOPILOT_LAND, asked_again_s=facts.time_s)


def _back_in_offboard(flight: FlightState, facts: FlightInputs) -> FlightState:
    """Note since when a vehicle that has been landed shows OFFBOARD again: PX4 falls back to it when it disarms."""
    landed = flight.left_offboard and facts.in_air is False
    again_s = min(flight.offboard_again_s, facts.time_s) if landed else math.inf
    return replace(flight, offboard_again_s=again_s)


def _resuming(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    if facts.mode is FlightMode.OFFBOARD and facts.armed:
        return resume(flight, facts, rules)
    if facts.armed and facts.time_s - flight.since_s < rules.resume_s:
        return flight
    why = "the autopilot did not show OFFBOARD" if facts.armed else "the vehicle was disarmed"
    said = f": {facts.text}" if facts.text and facts.text_s >= flight.since_s else ""
    return replace(give_back(flight, facts), reason=f"{why}{said}")


def _terminated(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """Until the autopilot shows it, for good: an arming that was under way may still show after the first asking."""
    if not facts.armed and facts.time_s - flight.since_s > rules.kill_settles_s:
        return replace(flight, asked_again_s=math.inf)
    if not facts.armed or facts.time_s - flight.asked_again_s < rules.kill_again_s:
        return flight
    return replace(flight, action=Action.KILL, asked_again_s=facts.time_s)


_STEPS: dict[Phase, Callable[[FlightState, FlightInputs, FlightRules], FlightState]] = {
    Phase.PREFLIGHT: _preflight,
    Phase.TAKEOFF: _takeoff,
    Phase.HOLD: _next_leg,
    Phase.TRACK: _next_leg,
    Phase.STOW: _stowing,
    Phase.LAND: _landing,
    Phase.HANDED_OVER: _handed_over,
    Phase.RESUME: _resuming,
    Phase.TERMINATED: _terminated,
}
