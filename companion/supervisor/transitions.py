"""The ways from one phase to another: what each makes of the flight. Pure; who takes which way is in phases.py."""

import math
from dataclasses import replace

import numpy as np

from companion.core.types import FlightMode, Reference
from companion.supervisor.faults import Event, FailsafeAction
from companion.supervisor.flight_state import Action, FlightInputs, FlightRules, FlightState, Leg, Phase, TrackRequest
from companion.trajectories.reference import Descent, Hold, MinimumJerk, minimum_jerk_duration_s

_LEAVING = 4.0
"""Minimum jerk from a speed v to a place anywhere near peaks at 3.9 v/T."""
_STOPPING = 1.5
"""Minimum jerk from a speed v to rest v T/2 further on peaks at 1.5 v/T."""
_BACK_S = 0.01
_LEAST_STOP_S = 0.8
"""The vehicle tilts first: less would be a jerk, and more leads further than the fence counts on."""


def reference_at(flight: FlightState, time_s: float) -> Reference:
    """The reference at a time (s), which may lie beyond the leg being flown."""
    start_s = flight.leg_start_s
    for leg in flight.legs[:-1]:
        if time_s < start_s + leg.trajectory.duration_s:
            return leg.trajectory.at(time_s - start_s)
        start_s += leg.trajectory.duration_s
    return flight.legs[-1].trajectory.at(time_s - start_s)


def turning_radps(flight: FlightState, time_s: float) -> float:
    """Return how fast the reference's heading turns at a time (s): a reference itself does not tell."""
    before, now = (reference_at(flight, time_s - back_s).yaw_rad for back_s in (_BACK_S, 0.0))
    return math.remainder(now - before, math.tau) / _BACK_S


def enter(flight: FlightState, phase: Phase, facts: FlightInputs, **changes: object) -> FlightState:
    """Begin a phase now."""
    return replace(flight, phase=phase, since_s=facts.time_s, **changes)  # type: ignore[arg-type]


def over(flight: FlightState, facts: FlightInputs) -> FlightState:
    """The flight is over."""
    return enter(flight, Phase.DISARMED, facts, airborne=False, landing_due_s=math.inf)


def lift_off(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """The law begins to fly: climb from here to the height that was asked for, and hold."""
    assert flight.ground_w_m is not None
    end = flight.ground_w_m + np.array([0.0, 0.0, flight.takeoff_height_m])
    distance = float(np.linalg.norm(end - facts.position_w_m))
    duration = minimum_jerk_duration_s(distance, rules.climb_speed_mps, rules.climb_accel_mps2)
    climb = MinimumJerk(facts.position_w_m, end, duration, flight.yaw_rad, flight.yaw_rad)
    legs = (Leg(Phase.TAKEOFF, climb), Leg(Phase.HOLD, Hold(end, flight.yaw_rad)))
    return replace(flight, airborne=True, legs=legs, leg_start_s=facts.time_s)


def approach(flight: FlightState, wanted: TrackRequest, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """To the trajectory's start, a wait there, the trajectory, and a hold at its end."""
    now = reference_at(flight, facts.time_s)
    start = wanted.trajectory.at(0.0)
    end = wanted.trajectory.at(wanted.trajectory.duration_s)
    distance = float(np.linalg.norm(start.position_w_m - now.position_w_m))
    stop_s = _LEAVING * float(np.linalg.norm(now.velocity_w_mps)) / rules.climb_accel_mps2
    turn_rad = abs((start.yaw_rad - now.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi)
    turning = turning_radps(flight, facts.time_s)
    stop_s = max(1.0, stop_s, _LEAVING * abs(turning) / rules.turn_accel_radps2)
    least_s = minimum_jerk_duration_s(float(turn_rad), rules.turn_radps, rules.turn_accel_radps2, stop_s)
    way = MinimumJerk(
        now.position_w_m,
        start.position_w_m,
        minimum_jerk_duration_s(distance, rules.climb_speed_mps, rules.climb_accel_mps2, least_s),
        now.yaw_rad,
        start.yaw_rad,
        now.velocity_w_mps,
        now.acceleration_w_mps2,
        turning,
    )
    legs = (
        Leg(Phase.HOLD, way),
        Leg(Phase.HOLD, Hold(start.position_w_m, start.yaw_rad, wanted.settle_s)),
        Leg(Phase.TRACK, wanted.trajectory),
        Leg(Phase.HOLD, Hold(end.position_w_m, end.yaw_rad)),
    )
    fresh = replace(flight, legs=legs, leg_start_s=facts.time_s, level=FailsafeAction.WARN, cause=None, reason="")
    return enter(fresh, Phase.HOLD, facts)


def brake(flight: FlightState, facts: FlightInputs, rules: FlightRules, phase: Phase) -> FlightState:
    """Come to rest on the reference's way, and hover."""
    now, turning = reference_at(flight, facts.time_s), turning_radps(flight, facts.time_s)
    return _rest(flight, facts, rules, phase, now, turning)


def resume(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """OFFBOARD shows: the law begins from where and how the autopilot has flown."""
    now = Reference(facts.position_w_m, facts.velocity_w_mps, np.zeros(3), facts.yaw_rad)
    return _rest(replace(flight, airborne=True, yaw_rad=facts.yaw_rad), facts, rules, Phase.HOLD, now)


def _rest(
    flight: FlightState,
    facts: FlightInputs,
    rules: FlightRules,
    phase: Phase,
    now: Reference,
    turning_radps: float = 0.0,
) -> FlightState:
    stop_s = max(_LEAST_STOP_S, _STOPPING * float(np.linalg.norm(now.velocity_w_mps)) / rules.braking_mps2)
    end = now.position_w_m + 0.5 * stop_s * now.velocity_w_mps
    end_yaw_rad = now.yaw_rad + 0.5 * stop_s * turning_radps
    begun = now.velocity_w_mps, now.acceleration_w_mps2, turning_radps
    stop = MinimumJerk(now.position_w_m, end, stop_s, now.yaw_rad, end_yaw_rad, *begun)
    legs = (Leg(phase, stop), Leg(phase, Hold(end, end_yaw_rad)))
    return enter(replace(flight, legs=legs, leg_start_s=facts.time_s), phase, facts)


def land(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """Down where the vehicle is: fold the arms first, which would touch the floor before it; not with broken ones."""
    if flight.airborne and not facts.arms_stowed and not facts.arm_fault:
        return brake(flight, facts, rules, Phase.STOW)
    return descend(flight, facts, rules) if flight.airborne else stop(flight, facts)


def descend(flight: FlightState, facts: FlightInputs, rules: FlightRules) -> FlightState:
    """Straight down from where the reference is."""
    now = reference_at(flight, facts.time_s)
    turning = turning_radps(flight, facts.time_s)
    down = Descent(now.position_w_m, now.velocity_w_mps, rules.descent_speed_mps, now.yaw_rad, yaw_rate_radps=turning)
    height_m = abs(float(now.position_w_m[2]) - ground_z_m(flight))
    due_s = facts.time_s + height_m / rules.descent_speed_mps
    legs = (Leg(Phase.LAND, down),)
    return enter(replace(flight, legs=legs, leg_start_s=facts.time_s, landing_due_s=due_s), Phase.LAND, facts)


def ground_z_m(flight: FlightState) -> float:
    """Height in W of the ground the vehicle stood on."""
    return 0.0 if flight.ground_w_m is None else float(flight.ground_w_m[2])


def stop(flight: FlightState, facts: FlightInputs) -> FlightState:
    """On the ground: end the preparation, or stop the motors."""
    ours = facts.armed and facts.mode is FlightMode.OFFBOARD
    if flight.phase is Phase.PREFLIGHT and not ours:
        return over(flight, facts)
    return enter(flight, Phase.LAND, facts, touched_down=True)


def hand_over(flight: FlightState, facts: FlightInputs) -> FlightState:
    """The autopilot lands."""
    handed = enter(flight, Phase.HANDED_OVER, facts, airborne=False, asked_again_s=facts.time_s)
    return replace(handed, action=Action.AUTOPILOT_LAND)


def let_go(flight: FlightState, facts: FlightInputs) -> FlightState:
    """Not one setpoint more; disarmed, it is over."""
    if not facts.armed:
        return over(flight, facts)
    return enter(flight, Phase.HANDED_OVER, facts, airborne=False, asked_again_s=facts.time_s)


def give_back(flight: FlightState, facts: FlightInputs) -> FlightState:
    """Out of RESUME: whoever flies goes on; in OFFBOARD nobody does, and PX4 lands, also if it shows only later."""
    if facts.armed and facts.mode is FlightMode.OFFBOARD:
        return replace(hand_over(flight, facts), level=FailsafeAction.AUTOPILOT_LAND)
    return replace(let_go(flight, facts), level=FailsafeAction.RELEASE, asked_again_s=-math.inf)


def terminate(flight: FlightState, facts: FlightInputs) -> FlightState:
    """The motors stop."""
    off = enter(flight, Phase.TERMINATED, facts, airborne=False, asked_again_s=facts.time_s)
    return replace(off, action=Action.KILL)


def then(reason: str, text: str) -> str:
    """The first cause stays in front of what it led to."""
    return f"{reason}; then {text}" if reason else text


def reacted(
    flight: FlightState, facts: FlightInputs, rules: FlightRules, event: Event, reaction: FailsafeAction
) -> FlightState:
    """What a reaction makes of the flight, and why it did."""
    known = replace(flight, level=reaction, cause=event.fault, reason=then(flight.reason, event.text))
    if flight.phase is Phase.RESUME and reaction < FailsafeAction.RELEASE:
        return give_back(known, facts)
    if reaction is FailsafeAction.HOLD:
        return brake(known, facts, rules, Phase.HOLD)
    if reaction is FailsafeAction.LAND:
        return land(known, facts, rules)
    if reaction is FailsafeAction.DISARM:
        return stop(known, facts)
    if reaction is FailsafeAction.AUTOPILOT_LAND:
        return hand_over(known, facts)
    return terminate(known, facts) if reaction is FailsafeAction.TERMINATE else let_go(known, facts)
