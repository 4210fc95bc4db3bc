"""Transitions between the flight's phases. Pure; state_machine.py decides which one is taken."""

import math
from dataclasses import replace

import numpy as np

from companion.core.types import Array, FlightMode, Reference
from companion.supervisor.faults import Event, FailsafeAction
from companion.supervisor.flight_state import Action, FlightInputs, FlightRules, FlightState, Leg, Phase, TrackRequest
from companion.supervisor.landing_place import landing_place
from companion.trajectories.reference import Descent, Hold, MinimumJerk, minimum_jerk_duration_s

_LEAVING = 4.0
"""Minimum jerk from a speed v to a nearby point has a peak acceleration of 3.9 v/T."""
_STOPPING = 1.5
"""Minimum jerk from a speed v to rest v T/2 further on has a peak acceleration of 1.5 v/T."""
_PUSHED_M = 0.3
"""Distance from the reference at which it follows; below the tracking error that is a fault."""
_AHEAD_M = 0.4
"""Distance by which it is then ahead sideways at most; below that error, too."""
_HEIGHT_M = 0.2
"""Difference of its height that is left then: a push sideways tilts and lifts the vehicle, and the law returns it."""
_BACK_S = 0.01
_LEAST_STOP_S = 0.8
"""The vehicle must tilt first: a shorter stop would jerk, a longer one would exceed the fence's stopping distance."""


def reference_at(flight: FlightState, time_s: float) -> Reference:
    """Return the reference at a time (s), which may lie beyond the leg being flown."""
    start_s = flight.leg_start_s
    for leg in flight.legs[:-1]:
        if time_s < start_s + leg.trajectory.duration_s:
            return leg.trajectory.at(time_s - start_s)
        start_s += leg.trajectory.duration_s
    return flight.legs[-1].trajectory.at(time_s - start_s)


def turning_radps(flight: FlightState, time_s: float) -> float:
    """Return the reference's heading rate at a time (s), which a reference itself does not contain."""
    before, now = (reference_at(flight, time_s - back_s).yaw_rad for back_s in (_BACK_S, 0.0))
    return math.remainder(now - before, math.tau) / _BACK_S


def enter(flight: FlightState, phase: Phase, inputs: FlightInputs, **changes: object) -> FlightState:
    """Return the flight in a new phase that begins now, with further changes."""
    return replace(flight, phase=phase, since_s=inputs.time_s, **changes)  # type: ignore[arg-type]


def end_flight(flight: FlightState, inputs: FlightInputs) -> FlightState:
    """Return the flight in phase DISARMED: it has ended."""
    return enter(flight, Phase.DISARMED, inputs, airborne=False, landing_due_s=math.inf)


def lift_off(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Activate the control law: climb from here to the requested height, and hold."""
    assert flight.ground_w_m is not None
    end = flight.ground_w_m + np.array([0.0, 0.0, flight.takeoff_height_m])
    distance = float(np.linalg.norm(end - inputs.position_w_m))
    duration = minimum_jerk_duration_s(distance, rules.climb_speed_mps, rules.climb_accel_mps2)
    at_rest = Reference(inputs.position_w_m, np.zeros(3), np.zeros(3), flight.yaw_rad)
    climb = _move(at_rest, 0.0, end, flight.yaw_rad, duration)
    legs = (Leg(Phase.TAKEOFF, climb), Leg(Phase.HOLD, Hold(end, flight.yaw_rad)))
    return replace(flight, airborne=True, legs=legs, leg_start_s=inputs.time_s)


def approach(flight: FlightState, request: TrackRequest, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Fly to the trajectory's start, wait there, fly the trajectory, and hold at its end."""
    now = reference_at(flight, inputs.time_s)
    start = request.trajectory.at(0.0)
    end = request.trajectory.at(request.trajectory.duration_s)
    distance = float(np.linalg.norm(start.position_w_m - now.position_w_m))
    stop_s = _LEAVING * float(np.linalg.norm(now.velocity_w_mps)) / rules.climb_accel_mps2
    turn_rad = abs((start.yaw_rad - now.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi)
    turning = turning_radps(flight, inputs.time_s)
    stop_s = max(1.0, stop_s, _LEAVING * abs(turning) / rules.turn_accel_radps2)
    least_s = minimum_jerk_duration_s(float(turn_rad), rules.turn_radps, rules.turn_accel_radps2, stop_s)
    duration_s = minimum_jerk_duration_s(distance, rules.climb_speed_mps, rules.climb_accel_mps2, least_s)
    legs = (
        Leg(Phase.HOLD, _move(now, turning, start.position_w_m, start.yaw_rad, duration_s)),
        Leg(Phase.HOLD, Hold(start.position_w_m, start.yaw_rad, request.settle_s)),
        Leg(Phase.TRACK, request.trajectory),
        Leg(Phase.HOLD, Hold(end.position_w_m, end.yaw_rad)),
    )
    fresh = replace(flight, legs=legs, leg_start_s=inputs.time_s, level=FailsafeAction.WARN, cause=None, reason="")
    return enter(fresh, Phase.HOLD, inputs)


def _move(now: Reference, turning_radps: float, end_w_m: Array, end_yaw_rad: float, duration_s: float) -> MinimumJerk:
    """Return the move to rest at a point and heading that continues the motion of a reference."""
    return MinimumJerk(
        start_w_m=now.position_w_m,
        end_w_m=end_w_m,
        duration_s=duration_s,
        start_yaw_rad=now.yaw_rad,
        end_yaw_rad=end_yaw_rad,
        start_velocity_w_mps=now.velocity_w_mps,
        start_acceleration_w_mps2=now.acceleration_w_mps2,
        start_yaw_rate_radps=turning_radps,
    )


def brake(flight: FlightState, inputs: FlightInputs, rules: FlightRules, phase: Phase) -> FlightState:
    """Bring the reference to rest along its path, and hover."""
    now, turning = reference_at(flight, inputs.time_s), turning_radps(flight, inputs.time_s)
    return _rest(flight, inputs, rules, phase, now, turning)


def resume(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Activate the control law in OFFBOARD, from the state in which the autopilot flew the vehicle."""
    now = Reference(inputs.position_w_m, inputs.velocity_w_mps, np.zeros(3), inputs.yaw_rad)
    return _rest(replace(flight, airborne=True, yaw_rad=inputs.yaw_rad), inputs, rules, Phase.HOLD, now)


def resting_place(now: Reference, braking_mps2: float) -> tuple[float, Array]:
    """Return how long (s) a reference takes to come to rest along its path, and where (3,)."""
    stop_s = max(_LEAST_STOP_S, _STOPPING * float(np.linalg.norm(now.velocity_w_mps)) / braking_mps2)
    return stop_s, now.position_w_m + 0.5 * stop_s * now.velocity_w_mps


def _rest(
    flight: FlightState,
    inputs: FlightInputs,
    rules: FlightRules,
    phase: Phase,
    now: Reference,
    turning_radps: float = 0.0,
) -> FlightState:
    stop_s, end = resting_place(now, rules.braking_mps2)
    end_yaw_rad = now.yaw_rad + 0.5 * stop_s * turning_radps
    stop = _move(now, turning_radps, end, end_yaw_rad, stop_s)
    legs = (Leg(phase, stop), Leg(phase, Hold(end, end_yaw_rad)))
    return enter(replace(flight, legs=legs, leg_start_s=inputs.time_s), phase, inputs)


def land(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Land where the vehicle is; arms without a fault are folded first, as they would touch the floor before it."""
    if flight.airborne and not inputs.arms_stowed and not inputs.arm_fault:
        return brake(flight, inputs, rules, Phase.STOW)
    return descend(flight, inputs, rules) if flight.airborne else stop(flight, inputs)


def descend(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Descend straight down from the reference's position, or from beside another vehicle that is below it."""
    return _descend_from(flight, inputs, rules, reference_at(flight, inputs.time_s))


def _descend_from(flight: FlightState, inputs: FlightInputs, rules: FlightRules, now: Reference) -> FlightState:
    turning = turning_radps(flight, inputs.time_s)
    aside = _aside(now, turning, inputs, rules)
    start = now if aside is None else aside.at(aside.duration_s)
    down = Descent(
        start_w_m=start.position_w_m,
        velocity_w_mps=start.velocity_w_mps,
        speed_mps=rules.descent_speed_mps,
        yaw_rad=start.yaw_rad,
        yaw_rate_radps=turning if aside is None else 0.0,
    )
    height_m = abs(float(now.position_w_m[2]) - ground_z_m(flight))
    due_s = inputs.time_s + height_m / rules.descent_speed_mps + (0.0 if aside is None else aside.duration_s)
    legs = (Leg(Phase.LAND, down),) if aside is None else (Leg(Phase.LAND, aside), Leg(Phase.LAND, down))
    return enter(replace(flight, legs=legs, leg_start_s=inputs.time_s, landing_due_s=due_s), Phase.LAND, inputs)


def _aside(now: Reference, turning_radps: float, inputs: FlightInputs, rules: FlightRules) -> MinimumJerk | None:
    """Return the way from above another vehicle to a place beside it; None if none is below."""
    if rules.land_clear is None or rules.land_inside is None or not inputs.others:
        return None
    x, y, z = now.position_w_m.tolist()
    place = landing_place((x, y, z), inputs.others, rules.land_clear, rules.land_inside, rules.fence_margin_m)
    if place == (x, y, z):
        return None
    distance_m, speed_mps = math.dist(place, (x, y, z)), float(np.linalg.norm(now.velocity_w_mps))
    least_s = max(1.0, _LEAVING * speed_mps / rules.climb_accel_mps2)
    duration_s = minimum_jerk_duration_s(distance_m, rules.climb_speed_mps, rules.climb_accel_mps2, least_s)
    return _move(now, turning_radps, np.array(place), now.yaw_rad, duration_s)


def follow_push(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> FlightState:
    """Hold or descend from where the vehicle is, if the guard has pushed it away from its reference for another one.

    It would return to where the other comes, and the distance would be taken for a loss of control. The height follows
    only where the guard pushes now, and never leads: else each push would lift the reference, and that the vehicle.
    """
    rests = flight.phase is Phase.HOLD and len(flight.legs) == 1
    if not inputs.pushed or not flight.airborne or not (rests or flight.phase is Phase.LAND):
        return flight
    reference = reference_at(flight, inputs.time_s)
    off = inputs.position_w_m - reference.position_w_m
    leaves = float(off @ inputs.velocity_w_mps) >= 0.0
    if not leaves or not float(np.linalg.norm(off)) > _PUSHED_M:
        return flight
    here = _near_rest(flight, inputs, rules, reference)
    if flight.phase is Phase.LAND:
        due_s = flight.landing_due_s  # as it was: a landing that is pushed about for ever is overdue
        return replace(_descend_from(flight, inputs, rules, here), since_s=flight.since_s, landing_due_s=due_s)
    return replace(flight, legs=(Leg(Phase.HOLD, Hold(here.position_w_m, here.yaw_rad)),), leg_start_s=inputs.time_s)


def _near_rest(flight: FlightState, inputs: FlightInputs, rules: FlightRules, before: Reference) -> Reference:
    """Return a reference as far ahead of a moving vehicle sideways as it needs to stop, and at most _AHEAD_M."""
    z_m, rate_mps = _followed_height(flight, inputs, before)
    sideways = np.array([*inputs.velocity_w_mps[:2], 0.0])
    level = np.array([*inputs.position_w_m[:2], z_m])
    _, end = resting_place(Reference(level, sideways, np.zeros(3), before.yaw_rad), rules.braking_mps2)
    way = end - level
    share = min(1.0, _AHEAD_M / max(float(np.linalg.norm(way)), 1e-6))
    return Reference(level + share * way, np.array([0.0, 0.0, rate_mps]), np.zeros(3), before.yaw_rad)


def _followed_height(flight: FlightState, inputs: FlightInputs, before: Reference) -> tuple[float, float]:
    """Return height (m) and rate (m/s) of the reference of a pushed vehicle; a landing's is never above the vehicle."""
    own_m, before_m, rate_mps = (float(v[2]) for v in (inputs.position_w_m, before.position_w_m, before.velocity_w_mps))
    lands = flight.phase is Phase.LAND
    z_m = max(before_m, own_m - _HEIGHT_M) if inputs.pushed_now else before_m
    if lands or inputs.pushed_now:
        z_m = min(z_m, own_m if lands else own_m + _HEIGHT_M)
    return z_m, min(rate_mps, 0.0) if lands and z_m <= before_m else 0.0


def ground_z_m(flight: FlightState) -> float:
    """Return the height in W of the ground the vehicle took off from, m; 0 when unknown."""
    return 0.0 if flight.ground_w_m is None else float(flight.ground_w_m[2])


def stop(flight: FlightState, inputs: FlightInputs) -> FlightState:
    """End the preparation on the ground, or stop the motors."""
    ours = inputs.armed and inputs.mode is FlightMode.OFFBOARD
    if flight.phase is Phase.PREFLIGHT and not ours:
        return end_flight(flight, inputs)
    return enter(flight, Phase.LAND, inputs, touched_down=True)


def hand_over(flight: FlightState, inputs: FlightInputs) -> FlightState:
    """Hand the vehicle over and command the autopilot to land."""
    handed = enter(flight, Phase.HANDED_OVER, inputs, airborne=False, command_sent_s=inputs.time_s)
    return replace(handed, action=Action.AUTOPILOT_LAND)


def release(flight: FlightState, inputs: FlightInputs) -> FlightState:
    """Stop sending setpoints; a flight that is disarmed ends."""
    if not inputs.armed:
        return end_flight(flight, inputs)
    return enter(flight, Phase.HANDED_OVER, inputs, airborne=False, command_sent_s=inputs.time_s)


def give_back(flight: FlightState, inputs: FlightInputs) -> FlightState:
    """Leave RESUME: the pilot or autopilot flies on; in OFFBOARD, also if it is reported later, PX4 lands."""
    if inputs.armed and inputs.mode is FlightMode.OFFBOARD:
        return replace(hand_over(flight, inputs), level=FailsafeAction.AUTOPILOT_LAND)
    return replace(release(flight, inputs), level=FailsafeAction.RELEASE, command_sent_s=-math.inf)


def terminate(flight: FlightState, inputs: FlightInputs) -> FlightState:
    """Stop the motors, in the air too."""
    off = enter(flight, Phase.TERMINATED, inputs, airborne=False, command_sent_s=inputs.time_s)
    return replace(off, action=Action.KILL)


def append_reason(reason: str, text: str) -> str:
    """Append a text to a reason, so that the first cause stays in front."""
    return f"{reason}; then {text}" if reason else text


def _hardly_flies(flight: FlightState, inputs: FlightInputs, rules: FlightRules) -> bool:
    """Return true for a takeoff that would come to rest just above the ground."""
    _, rest_w_m = resting_place(reference_at(flight, inputs.time_s), rules.braking_mps2)
    return flight.phase is Phase.TAKEOFF and rest_w_m[2] - ground_z_m(flight) < rules.lowest_hold_m


def execute_action(
    flight: FlightState, inputs: FlightInputs, rules: FlightRules, event: Event, reaction: FailsafeAction
) -> FlightState:
    """Execute a failsafe action, and note its event as the reason."""
    changed = replace(flight, level=reaction, cause=event.fault, reason=append_reason(flight.reason, event.text))
    if flight.phase is Phase.RESUME and reaction < FailsafeAction.RELEASE:
        return give_back(changed, inputs)
    if reaction is FailsafeAction.HOLD and not _hardly_flies(flight, inputs, rules):
        return brake(changed, inputs, rules, Phase.HOLD)
    if reaction in {FailsafeAction.HOLD, FailsafeAction.LAND}:
        return land(changed, inputs, rules)
    if reaction is FailsafeAction.DISARM:
        return stop(changed, inputs)
    if reaction is FailsafeAction.AUTOPILOT_LAND:
        return hand_over(changed, inputs)
    return terminate(changed, inputs) if reaction is FailsafeAction.TERMINATE else release(changed, inputs)
