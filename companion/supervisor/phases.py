"""Flight phases as a pure machine: facts and requests in, the next phase and its reference out.

On the ground the law sleeps: it is started at lift-off, so nothing it integrates can wind up against the floor.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from companion.control.reference import Descent, Hold, MinimumJerk, minimum_jerk_duration_s
from companion.supervisor.flight import (
    COMMANDED,
    STREAMING,
    Action,
    Facts,
    Flight,
    FlightRules,
    Fly,
    HandOver,
    Land,
    Leg,
    Phase,
    Prepare,
    Request,
    TakeOff,
)
from companion.types import FlightMode, Reference

_BRAKING = 4.0
"""A minimum-jerk stop from a speed v within T peaks at 3.9 v/T."""


def reference_at(flight: Flight, time_s: float) -> Reference:
    """The reference at a time (s), which may lie beyond the leg being flown."""
    start_s = flight.leg_start_s
    for leg in flight.legs[:-1]:
        if time_s < start_s + leg.trajectory.duration_s:
            return leg.trajectory.at(time_s - start_s)
        start_s += leg.trajectory.duration_s
    return flight.legs[-1].trajectory.at(time_s - start_s)


def ground_thrust(flight: Flight, time_s: float, rules: FlightRules) -> float:
    """Thrust while the law sleeps: idle, ramping up, or ramping down after touchdown."""
    since = time_s - flight.since_s
    if flight.phase is not Phase.TAKEOFF:
        return 0.0
    quick = rules.quick_ramp * since / rules.spool_up_s
    slow = rules.quick_ramp + rules.slow_ramp_ps * (since - rules.spool_up_s)
    return rules.hover_thrust * min(quick if since < rules.spool_up_s else slow, rules.ramp_overshoot)


def _ramp_time_s(rules: FlightRules) -> float:
    return rules.spool_up_s + (rules.ramp_overshoot - rules.quick_ramp) / rules.slow_ramp_ps


def request(flight: Flight, wanted: Request, facts: Facts, rules: FlightRules) -> Flight:
    """Take an operator's request; what does not fit the phase is ignored (the service refuses it before)."""
    if not can(flight, wanted):
        return flight
    if isinstance(wanted, HandOver):
        return _hand_over(flight, facts, wanted.reason)
    if isinstance(wanted, Prepare):
        return replace(Flight(yaw_rad=facts.yaw_rad), phase=Phase.PREFLIGHT, since_s=facts.time_s)
    if isinstance(wanted, TakeOff):
        return _enter(flight, Phase.TAKEOFF, facts, ground_w_m=facts.position_w_m, takeoff_height_m=wanted.height_m)
    if isinstance(wanted, Fly):
        return _fly(flight, wanted, facts, rules)
    return _land(flight, facts, rules)


def can(flight: Flight, wanted: Request) -> bool:
    """Whether a request fits the phase."""
    allowed: dict[type, frozenset[Phase]] = {
        Prepare: frozenset({Phase.STANDBY, Phase.DISARMED, Phase.PREFLIGHT}),
        TakeOff: frozenset({Phase.ARMED}),
        Fly: frozenset({Phase.HOLD, Phase.TRACK}),
        Land: STREAMING,
        HandOver: COMMANDED,
    }
    return flight.phase in allowed[type(wanted)]


def advance(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    """One tick: what the facts make of the phase."""
    flight = replace(flight, action=None) if flight.action else flight
    if flight.phase in COMMANDED:
        if not facts.armed:
            return _over(flight, facts, "" if flight.touched_down or not flight.airborne else "disarmed in the air")
        if facts.mode is not FlightMode.OFFBOARD:
            reason = f"the autopilot left OFFBOARD for {facts.mode}"
            over = _enter(flight, Phase.HANDED_OVER, facts, airborne=False, land_asked_s=facts.time_s)
            return replace(over, reason=reason)
    if flight.phase in STREAMING and facts.mocap_age_s > rules.mocap_timeout_s:
        return _blind(flight, facts, rules, f"motion capture has been silent for {facts.mocap_age_s:.2f} s")
    if facts.arm_fault and rules.land_on_arm_fault and flight.phase in _ENDED_BY_ARM_FAULT:
        return _arms_failed(flight, facts, rules)
    step = _STEPS.get(flight.phase)
    return step(flight, facts, rules) if step else flight


def _preflight(flight: Flight, facts: Facts, _: FlightRules) -> Flight:
    flight = replace(flight, yaw_rad=facts.yaw_rad)
    ready = facts.armed and facts.mode is FlightMode.OFFBOARD
    return _enter(flight, Phase.ARMED, facts) if ready else flight


def _takeoff(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    assert flight.ground_w_m is not None
    if not flight.airborne:
        height = float(facts.position_w_m[2] - flight.ground_w_m[2])
        if height > rules.lift_off_m and facts.velocity_w_mps[2] > 0.0:
            return _lift_off(flight, facts, rules)
        if facts.time_s - flight.since_s > _ramp_time_s(rules) + rules.lift_off_wait_s:
            thrust = rules.hover_thrust * rules.ramp_overshoot
            reason = f"no lift-off at thrust {thrust:.2f}: check vehicle.hover_thrust, propellers and battery"
            return replace(_enter(flight, Phase.LAND, facts, touched_down=True), reason=reason)
        return flight
    return _next_leg(flight, facts)


def _lift_off(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    assert flight.ground_w_m is not None
    end = flight.ground_w_m + np.array([0.0, 0.0, flight.takeoff_height_m])
    distance = float(np.linalg.norm(end - facts.position_w_m))
    duration = minimum_jerk_duration_s(distance, rules.climb_speed_mps, rules.climb_accel_mps2)
    climb = MinimumJerk(facts.position_w_m, end, duration, flight.yaw_rad, flight.yaw_rad)
    legs = (Leg(Phase.TAKEOFF, climb), Leg(Phase.HOLD, Hold(end, flight.yaw_rad)))
    return replace(flight, airborne=True, legs=legs, leg_start_s=facts.time_s)


def _next_leg(flight: Flight, facts: Facts, _: FlightRules | None = None) -> Flight:
    """Go on to the next leg when the present one is flown; the last one is held."""
    if len(flight.legs) < 2 or facts.time_s < flight.leg_start_s + flight.legs[0].trajectory.duration_s:
        return flight
    start_s = flight.leg_start_s + flight.legs[0].trajectory.duration_s
    flight = replace(flight, legs=flight.legs[1:], leg_start_s=start_s)
    return flight if flight.legs[0].phase is flight.phase else _enter(flight, flight.legs[0].phase, facts)


def _fly(flight: Flight, wanted: Fly, facts: Facts, rules: FlightRules) -> Flight:
    now = reference_at(flight, facts.time_s)
    start = wanted.trajectory.at(0.0)
    end = wanted.trajectory.at(wanted.trajectory.duration_s)
    distance = float(np.linalg.norm(start.position_w_m - now.position_w_m))
    stop_s = _BRAKING * float(np.linalg.norm(now.velocity_w_mps)) / rules.climb_accel_mps2
    turn_rad = abs((start.yaw_rad - now.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi)
    least_s = max(1.0, stop_s, 1.875 * float(turn_rad) / rules.turn_radps)
    way = MinimumJerk(
        now.position_w_m,
        start.position_w_m,
        minimum_jerk_duration_s(distance, rules.climb_speed_mps, rules.climb_accel_mps2, least_s),
        now.yaw_rad,
        start.yaw_rad,
        now.velocity_w_mps,
        now.acceleration_w_mps2,
    )
    legs = (
        Leg(Phase.HOLD, way),
        Leg(Phase.HOLD, Hold(start.position_w_m, start.yaw_rad, wanted.settle_s)),
        Leg(Phase.TRACK, wanted.trajectory),
        Leg(Phase.HOLD, Hold(end.position_w_m, end.yaw_rad)),
    )
    return _enter(replace(flight, legs=legs, leg_start_s=facts.time_s), Phase.HOLD, facts)


def _land(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    if flight.phase is Phase.PREFLIGHT:
        return _over(flight, facts, "")
    if flight.phase in {Phase.STOW, Phase.LAND} or flight.phase not in COMMANDED:
        return flight
    if not flight.airborne:
        return _enter(flight, Phase.LAND, facts, touched_down=True)
    return _descend(flight, facts, rules) if facts.arms_stowed else _stow(flight, facts, rules)


def _stow(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    """Come to rest and hover: the arms would touch the floor first."""
    now = reference_at(flight, facts.time_s)
    stop_s = max(1.0, _BRAKING * float(np.linalg.norm(now.velocity_w_mps)) / rules.climb_accel_mps2)
    end = now.position_w_m + 0.5 * stop_s * now.velocity_w_mps
    stop = MinimumJerk(
        now.position_w_m, end, stop_s, now.yaw_rad, now.yaw_rad, now.velocity_w_mps, now.acceleration_w_mps2
    )
    legs = (Leg(Phase.STOW, stop), Leg(Phase.STOW, Hold(end, now.yaw_rad)))
    return _enter(replace(flight, legs=legs, leg_start_s=facts.time_s), Phase.STOW, facts)


def _stowing(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    """Wait for the arms; a fault or the time ends the waiting, and the arms' fault is the reason that is told."""
    late = facts.time_s - flight.since_s > rules.stow_time_s
    hindered = facts.arm_fault or facts.cannot_stow or ("the arms were not stowed in time" if late else "")
    if not (facts.arms_stowed or hindered):
        return _next_leg(flight, facts)
    why = flight.reason or ("" if facts.arms_stowed else hindered)
    return replace(_descend(flight, facts, rules), reason=why)


def _arms_failed(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    """The arms hold still where they are: land with them so, or do not begin."""
    if flight.phase is Phase.PREFLIGHT:
        return _over(flight, facts, facts.arm_fault)
    landing = _descend(flight, facts, rules) if flight.airborne else _land(flight, facts, rules)
    return replace(landing, reason=facts.arm_fault)


def _descend(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    now = reference_at(flight, facts.time_s)
    down = Descent(now.position_w_m, now.velocity_w_mps, rules.descent_speed_mps, now.yaw_rad)
    legs = (Leg(Phase.LAND, down),)
    return _enter(replace(flight, legs=legs, leg_start_s=facts.time_s), Phase.LAND, facts)


def _landing(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    if flight.touched_down:
        since_s = flight.since_s if flight.disarm_asked_s is None else flight.disarm_asked_s
        wait_s = rules.touchdown_s if flight.disarm_asked_s is None else rules.disarm_again_s
        due = facts.time_s - since_s > wait_s
        return replace(flight, action=Action.DISARM, disarm_asked_s=facts.time_s) if due else flight
    ground_z = flight.ground_w_m[2] if flight.ground_w_m is not None else 0.0
    low = facts.position_w_m[2] - ground_z < rules.touchdown_m
    slow = abs(float(facts.velocity_w_mps[2])) < rules.touchdown_speed_mps
    below_m = float(facts.position_w_m[2] - reference_at(flight, facts.time_s).position_w_m[2])
    standing = low and below_m > 0.0
    if not slow or not (standing or below_m > rules.stuck_below_m):
        return replace(flight, still_since_s=None)
    since = flight.still_since_s if flight.still_since_s is not None else facts.time_s
    if facts.time_s - since < (rules.touchdown_s if standing else rules.stuck_s):
        return replace(flight, still_since_s=since)
    return replace(
        flight, airborne=False, touched_down=True, since_s=facts.time_s, still_since_s=None, yaw_rad=facts.yaw_rad
    )


def _blind(flight: Flight, facts: Facts, rules: FlightRules, reason: str) -> Flight:
    """Without motion capture: on the ground stop, in the air let the autopilot land."""
    if flight.phase is Phase.PREFLIGHT:
        return _over(flight, facts, reason)
    if flight.phase is Phase.ARMED:
        return replace(_enter(flight, Phase.LAND, facts, touched_down=True), reason=reason)
    if flight.touched_down:
        return _landing(flight, facts, rules)
    return _hand_over(flight, facts, reason)


def _hand_over(flight: Flight, facts: Facts, reason: str) -> Flight:
    over = _enter(flight, Phase.HANDED_OVER, facts, airborne=False, land_asked_s=facts.time_s)
    return replace(over, action=Action.AUTOPILOT_LAND, reason=reason)


def _handed_over(flight: Flight, facts: Facts, rules: FlightRules) -> Flight:
    """Until it is down; OFFBOARD would mean that nobody flies it: the autopilot holds our last setpoint."""
    if not facts.armed:
        return _over(flight, facts, flight.reason)
    if facts.mode is not FlightMode.OFFBOARD or facts.time_s - flight.land_asked_s < rules.land_again_s:
        return flight
    return replace(flight, action=Action.AUTOPILOT_LAND, land_asked_s=facts.time_s)


def _over(flight: Flight, facts: Facts, reason: str) -> Flight:
    return replace(_enter(flight, Phase.DISARMED, facts, airborne=False), reason=reason or flight.reason)


def _enter(flight: Flight, phase: Phase, facts: Facts, **changes: object) -> Flight:
    return replace(flight, phase=phase, since_s=facts.time_s, **changes)  # type: ignore[arg-type]


_ENDED_BY_ARM_FAULT = frozenset({Phase.PREFLIGHT, Phase.ARMED, Phase.TAKEOFF, Phase.HOLD, Phase.TRACK})
_STEPS: dict[Phase, Callable[[Flight, Facts, FlightRules], Flight]] = {
    Phase.PREFLIGHT: _preflight,
    Phase.TAKEOFF: _takeoff,
    Phase.HOLD: _next_leg,
    Phase.TRACK: _next_leg,
    Phase.STOW: _stowing,
    Phase.LAND: _landing,
    Phase.HANDED_OVER: _handed_over,
}
