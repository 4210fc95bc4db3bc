"""State machine of a flight. Pure: inputs and requests in, the next phase and its reference out.

Faults arrive as events. faults.TABLE gives their failsafe actions, and the strongest one is executed unless an equal
or stronger one was executed before. On the ground the law is not active: it starts at lift-off, so that its integrators
cannot wind up against the floor.
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
from companion.supervisor.rejections import REJECTIONS
from companion.supervisor.requested_path import others_in_the_way
from companion.supervisor.transitions import (
    append_reason,
    approach,
    brake,
    descend,
    end_flight,
    enter,
    execute_action,
    follow_push,
    give_back,
    ground_z_m,
    hand_over,
    land,
    lift_off,
    reference_at,
    resume,
    stop,
)

_TRAFFIC = frozenset({Fault.TRAFFIC, Fault.TRAFFIC_BLOCKED})

__all__ = ["advance", "apply_request", "ground_thrust", "reference_at", "refusal", "strongest"]


def refusal(flight: FlightState, request: Request, inputs: FlightInputs, rules: FlightRules) -> str:
    """Return why a request is rejected: the state and what to do; empty when it is accepted."""
    rejection = REJECTIONS[type(request)].get(flight.phase)
    if rejection is not None:
        return rejection
    if isinstance(request, HoldRequest) and not flight.airborne:
        return "the vehicle is not in the air yet; run `companion abort` to stop the motors"
    if isinstance(request, ResumeRequest) and not inputs.armed:
        return "the vehicle is disarmed; run `companion arm` first"
    if isinstance(request, ResumeRequest) and not inputs.position_w_m[2] - ground_z_m(flight) > rules.touchdown_m:
        return "the vehicle stands on the ground; run `companion disarm`"
    starts = isinstance(request, TakeoffRequest | TrackRequest | ResumeRequest)
    if not starts:
        return ""
    return _blocking_fault(flight, request, inputs, rules) or others_in_the_way(flight, request, inputs, rules)


def _blocking_fault(flight: FlightState, request: Request, inputs: FlightInputs, rules: FlightRules) -> str:
    """Return the fault that would end the requested flight at once; empty without one.

    A trajectory may lead out of traffic: whether it does is asked of its own path.
    """
    if isinstance(request, TrackRequest):
        inputs = replace(inputs, events=tuple(event for event in inputs.events if event.fault not in _TRAFFIC))
    event, _ = strongest(replace(flight, phase=Phase.HOLD, airborne=True), inputs, rules)
    return "" if event is None else event.text


def apply_request(
    flight: FlightState, request: Request, inputs: FlightInputs, rules: FlightRules
) -> tuple[FlightState, str]:
    """Apply an operator's request; return the flight, unchanged with the reason when the request is rejected."""
    rejection = refusal(flight, request, inputs, rules)
    return (flight, rejection) if rejection else (_apply(replace(flight, action=None), request, inputs, rules), "")


def _apply(flight: FlightState, request: Request, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    if isinstance(request, HandOverRequest | KillRequest):
        return _hand_over_or_kill(flight, request, inputs, rules)
    if isinstance(request, LandRequest):
        return _request_landing(replace(flight, reason=flight.reason or request.reason), inputs, rules)
    if isinstance(request, TrackRequest):
        return approach(flight, request, inputs, rules)
    if isinstance(request, HoldRequest):
        return brake(flight, inputs, rules, Phase.HOLD)
    return _start(flight, request, inputs)


def _hand_over_or_kill(
    flight: FlightState, request: HandOverRequest | KillRequest, inputs: FlightInputs, rules: FlightRules
) -> FlightState:
    """Let the autopilot land the vehicle, or stop its motors."""
    if isinstance(request, HandOverRequest):
        flight = replace(flight, cause=None, reason=append_reason(flight.reason, request.reason))
        if flight.phase is Phase.RESUME:
            return give_back(flight, inputs)
        return replace(hand_over(flight, inputs), level=FailsafeAction.AUTOPILOT_LAND)
    killed = Event(Fault.KILL, "the operator stopped the motors")
    return execute_action(flight, inputs, rules, killed, FailsafeAction.TERMINATE)


def _start(
    flight: FlightState, request: ArmRequest | TakeoffRequest | ResumeRequest, inputs: FlightInputs
) -> FlightState:
    """Start a flight: on the ground, or with a vehicle that the autopilot or a pilot has flown."""
    if isinstance(request, ArmRequest):
        return enter(FlightState(yaw_rad=inputs.yaw_rad, ground_w_m=inputs.position_w_m), Phase.PREFLIGHT, inputs)
    if isinstance(request, TakeoffRequest):
        height_m = request.height_m
        return enter(flight, Phase.TAKEOFF, inputs, ground_w_m=inputs.position_w_m, takeoff_height_m=height_m)
    fresh = FlightState(yaw_rad=inputs.yaw_rad, ground_w_m=flight.ground_w_m)
    return replace(enter(fresh, Phase.RESUME, inputs), action=Action.OFFBOARD)


def _request_landing(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    if flight.phase is Phase.RESUME:
        return give_back(flight, inputs)
    if flight.phase is Phase.HANDED_OVER:  # also with a pilot: PX4 treats it as the pilot's command
        return replace(flight, action=Action.AUTOPILOT_LAND, command_sent_s=inputs.time_s)
    return flight if flight.phase in {Phase.STOW, Phase.LAND} else land(flight, inputs, rules)


def advance(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Advance the state machine by one tick."""
    flight = replace(flight, action=None) if flight.action else flight
    if flight.touched_down and flight.phase is Phase.LAND and not inputs.armed:
        return end_flight(flight, inputs)  # intended: mode changes that follow from disarming are no fault
    if flight.phase in STREAMING or flight.phase is Phase.HANDED_OVER:
        event, reaction = strongest(flight, inputs, rules)
        stopping = flight.touched_down and reaction is FailsafeAction.DISARM
        if event is not None and reaction > flight.level and not stopping:
            return execute_action(flight, inputs, rules, event, reaction)
    if flight.phase in COMMANDED and not inputs.armed:
        return end_flight(flight, inputs)
    step = _STEPS.get(flight.phase)
    return follow_push(step(flight, inputs, rules), inputs, rules) if step else flight


def strongest(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> tuple[Event | None, FailsafeAction]:
    """Return the event with the strongest action in this stage and that action; among equals the table's first."""
    worst, strongest_action = None, FailsafeAction.WARN
    for event in inputs.events:
        if event.fault is Fault.ARMS and not rules.land_on_arm_fault:
            continue
        if event.fault is Fault.ROOM_LEFT and _pilot_flies(flight, inputs):
            continue  # the pilot decides about the motors, too
        reaction = reaction_to(event.fault, flight.stage)
        if reaction > strongest_action:
            worst, strongest_action = event, reaction
    return worst, strongest_action


def _pilot_flies(flight: FlightState, inputs: FlightInputs) -> bool:
    """Return true if a pilot flies: not in OFFBOARD, nor in PX4's landing or failsafe unless a pilot flew before."""
    if flight.phase not in {Phase.HANDED_OVER, Phase.RESUME}:
        return False
    if inputs.failsafe:
        return flight.theirs
    if inputs.mode is FlightMode.OFFBOARD:
        return flight.theirs and inputs.in_air is False  # landed and disarmed, see _step_handed_over
    return inputs.mode is not FlightMode.LAND or flight.theirs or flight.cause is Fault.MODE_CHANGED


def ground_thrust(flight: FlightState, time_s: float, rules: FlightRules) -> float:
    """Return the thrust while the law is not active: idle, ramping up, or hover thrust during a resume."""
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


def _step_preflight(flight: FlightState, inputs: FlightInputs, _: FlightRules) -> FlightState:
    flight = replace(flight, yaw_rad=inputs.yaw_rad, ground_w_m=inputs.position_w_m)
    ready = inputs.armed and inputs.mode is FlightMode.OFFBOARD
    return enter(flight, Phase.ARMED, inputs) if ready else flight


def _step_takeoff(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    if flight.airborne:
        return _next_leg(flight, inputs, rules)
    height_m = float(inputs.position_w_m[2]) - ground_z_m(flight)
    if height_m > rules.lift_off_m and inputs.velocity_w_mps[2] > 0.0:
        return lift_off(flight, inputs, rules)
    return _no_lift_off(flight, inputs, rules)


def _no_lift_off(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """End the takeoff when the thrust should have lifted the vehicle; stop the motors only if PX4 reports landed.

    Motion capture may track another body while the vehicle climbs without control.
    """
    waited_s, stands = inputs.time_s - flight.since_s - _ramp_time_s(rules), inputs.in_air is False
    if waited_s <= (rules.lift_off_wait_s if stands else 0.0):
        return flight
    thrust, check = rules.hover_thrust * rules.ramp_overshoot, "vehicle.hover_thrust, propellers and battery"
    if stands:
        return replace(stop(flight, inputs), reason=f"no lift-off at thrust {thrust:.2f}: check {check}")
    why = f"no lift-off seen at thrust {thrust:.2f}, and PX4 does not say that it stands"
    event = Event(Fault.LIFT_OFF_UNSEEN, f"{why}: check that QTM's body is the vehicle, {check}")
    return execute_action(flight, inputs, rules, event, reaction_to(event.fault, Stage.FLYING))


def _next_leg(flight: FlightState, inputs: FlightInputs, _: FlightRules) -> FlightState:
    """Continue with the next leg when the present one is flown; the last one is held."""
    if len(flight.legs) < 2 or inputs.time_s < flight.leg_start_s + flight.legs[0].trajectory.duration_s:
        return flight
    start_s = flight.leg_start_s + flight.legs[0].trajectory.duration_s
    flight = replace(flight, legs=flight.legs[1:], leg_start_s=start_s)
    return flight if flight.legs[0].phase is flight.phase else enter(flight, flight.legs[0].phase, inputs)


def _step_stow(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Wait for the arms to fold; an arm fault or the time limit ends the wait and becomes the flight's reason."""
    late = inputs.time_s - flight.since_s > rules.stow_time_s
    hindered = inputs.arm_fault or inputs.cannot_stow or ("the arms were not stowed in time" if late else "")
    if not (inputs.arms_stowed or hindered):
        return _next_leg(flight, inputs, rules)
    why = flight.reason or ("" if inputs.arms_stowed else hindered)
    return replace(descend(flight, inputs, rules), reason=why)


def _step_land(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    if flight.touched_down:
        return _step_disarm(flight, inputs, rules)
    low = inputs.position_w_m[2] - ground_z_m(flight) < rules.touchdown_m
    slow = abs(float(inputs.velocity_w_mps[2])) < rules.touchdown_speed_mps
    below_m = float(inputs.position_w_m[2] - reference_at(flight, inputs.time_s).position_w_m[2])
    standing = low and below_m > 0.0
    stuck = below_m > rules.stuck_below_m and _stands_on_something(inputs, rules)
    if not slow or not (standing or stuck):
        return replace(flight, still_since_s=None)
    since = flight.still_since_s if flight.still_since_s is not None else inputs.time_s
    if inputs.time_s - since < (rules.touchdown_s if standing else rules.stuck_s):
        return replace(flight, still_since_s=since)
    return replace(
        flight, airborne=False, touched_down=True, since_s=inputs.time_s, still_since_s=None, yaw_rad=inputs.yaw_rad
    )


def _step_disarm(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Command disarm when PX4 accepts it: it rejects it ("not landed") until its land detector reports landed."""
    if flight.disarm_asked_s is not None:
        due = inputs.time_s - flight.disarm_asked_s > rules.disarm_again_s
    else:
        unknown_s, in_air_s = rules.disarm_wait_unknown_s, rules.disarm_wait_in_air_s
        wait_s = {None: unknown_s, True: in_air_s, False: rules.touchdown_s}[inputs.in_air]
        due = inputs.time_s - flight.since_s > wait_s
    return replace(flight, action=Action.DISARM, disarm_asked_s=inputs.time_s) if due else flight


def _stands_on_something(inputs: FlightInputs, rules: FlightRules) -> bool:
    """Return true if the vehicle stands on something: in the air it would need its hover thrust to stay there."""
    return inputs.in_air is False or inputs.thrust < rules.stuck_thrust * rules.hover_thrust


def _step_handed_over(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Wait until the vehicle is disarmed; in OFFBOARD the autopilot holds our last setpoint, so command it to land."""
    if not inputs.armed:
        return end_flight(flight, inputs)
    if not flight.theirs and _pilot_flies(flight, inputs):
        flight = replace(flight, theirs=True)
    if inputs.mode is not FlightMode.OFFBOARD:
        return replace(flight, left_offboard=True, offboard_again_s=math.inf)
    flight = _back_in_offboard(flight, inputs)
    disarms = 0.0 <= inputs.time_s - flight.offboard_again_s < rules.disarm_shows_s
    if disarms or inputs.time_s - flight.command_sent_s < rules.land_again_s:
        return flight
    return replace(flight, action=Action.AUTOPILOT_LAND, command_sent_s=inputs.time_s)


def _back_in_offboard(flight: FlightState, inputs: FlightInputs) -> FlightState:
    """Note the time at which a landed vehicle reports OFFBOARD again: PX4 falls back to it when it disarms."""
    landed = flight.left_offboard and inputs.in_air is False
    again_s = min(flight.offboard_again_s, inputs.time_s) if landed else math.inf
    return replace(flight, offboard_again_s=again_s)


def _step_resume(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    if inputs.mode is FlightMode.OFFBOARD and inputs.armed:
        return resume(flight, inputs, rules)
    if inputs.armed and inputs.time_s - flight.since_s < rules.resume_s:
        return flight
    why = "the autopilot did not show OFFBOARD" if inputs.armed else "the vehicle was disarmed"
    said = f": {inputs.text}" if inputs.text and inputs.text_s >= flight.since_s else ""
    return replace(give_back(flight, inputs), reason=f"{why}{said}")


def _step_terminated(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Repeat the kill command until the vehicle stays disarmed: an arming under way may show after the first one."""
    if not inputs.armed and inputs.time_s - flight.since_s > rules.kill_settles_s:
        return replace(flight, command_sent_s=math.inf)
    if not inputs.armed or inputs.time_s - flight.command_sent_s < rules.kill_again_s:
        return flight
    return replace(flight, action=Action.KILL, command_sent_s=inputs.time_s)


_STEPS: dict[Phase, Callable[[FlightState, FlightInputs, FlightRules], FlightState]] = {
    Phase.PREFLIGHT: _step_preflight,
    Phase.TAKEOFF: _step_takeoff,
    Phase.HOLD: _next_leg,
    Phase.TRACK: _next_leg,
    Phase.STOW: _step_stow,
    Phase.LAND: _step_land,
    Phase.HANDED_OVER: _step_handed_over,
    Phase.RESUME: _step_resume,
    Phase.TERMINATED: _step_terminated,
}
