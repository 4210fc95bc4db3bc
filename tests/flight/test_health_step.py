"""Inputs of the health checks from a flight: when it is commanded, and where the vehicle should be."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.types import Array, AttitudeThrust, FlightMode, MocapFrame
from companion.estimation.estimator import EstimatorState
from companion.estimation.state import Verdict
from companion.flight.health_step import Cycle, HealthStep, Sides, facts_of
from companion.supervisor.faults import Event, Fault
from companion.supervisor.flight_state import FlightState, Phase
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.state_machine import advance, reference_at
from tests.supervisor.flown import GROUND, RULES, STATES, facts
from tests.supervisor.observing import CYCLE_S, FENCE, LEVEL, healthy

SLOW = 100
"""Cycles."""


def cycle(time_s: float, position_w_m: Array, mode: FlightMode = FlightMode.OFFBOARD, late: int = 0) -> Cycle:
    """One good frame, an autopilot that hears and is heard."""
    seen = healthy(0)
    assert seen.mocap.vehicle is not None
    vehicle = replace(seen.mocap.vehicle, time_s=time_s - 0.01, position_w_m=position_w_m)
    frame = MocapFrame(
        frame=round(time_s / CYCLE_S),
        stamp_s=time_s - 0.01,
        received_s=time_s,
        position_w_m=position_w_m,
        rotation_w_b=np.eye(3),
        residual_m=0.0,
        late=late,
    )
    status = replace(seen.autopilot, heard_s=time_s, heartbeat_s=time_s, attitude_s=time_s, boot_s=time_s, mode=mode)
    estimate = EstimatorState(vehicle=vehicle, verdict=Verdict.ACCEPTED)
    return Cycle(
        time_s=time_s,
        late_s=0.0,
        frame=frame,
        estimate=estimate,
        status=status,
        streaming=True,
        sent=AttitudeThrust(LEVEL, np.array(0.5)),
        at_max_thrust=False,
        law_fault="",
        arm_fault="",
    )


def told(flight: FlightState, cycles: list[Cycle]) -> set[Fault]:
    stage = HealthStep(SafetyRules(), FENCE, Sides())
    return {event.fault for one in cycles for event in stage.look(one, flight)}


def test_a_pilot_may_take_a_vehicle_that_has_touched_down_until_it_is_asked_to_disarm() -> None:
    flight, time_s = STATES["touched down"]
    theirs = cycle(time_s + 0.1, GROUND, FlightMode.POSITION)
    assert told(flight, [theirs]) == {Fault.MODE_CHANGED}
    taken = advance(flight, facts(time_s + 0.1, 0.0, Fault.MODE_CHANGED, mode=FlightMode.POSITION), RULES)
    assert (taken.phase, taken.action) == (Phase.HANDED_OVER, None), "never disarmed by us any more"
    assert told(replace(flight, disarm_asked_s=time_s), [theirs]) == set()


def staying_up(flight: FlightState, time_s: float, height_m: float) -> list[Cycle]:
    place = reference_at(flight, time_s).position_w_m * [1.0, 1.0, 0.0] + [0.0, 0.0, height_m]
    return [cycle(time_s + k * CYCLE_S, place) for k in range(SLOW)]


@pytest.mark.parametrize("off_m", [0.7, -0.7])
def test_a_landing_that_does_not_come_down_is_a_tracking_error(off_m: float) -> None:
    """Above or below its reference alike."""
    flight, time_s = STATES["descending"]
    height_m = float(reference_at(flight, time_s + 0.5).position_w_m[2]) + off_m
    assert Fault.TRACKING_ERROR in told(flight, staying_up(flight, time_s, height_m))


def test_who_seems_to_stand_cannot_follow_the_descent_into_the_ground() -> None:
    flight, time_s = STATES["descending"]
    above_m = float(reference_at(flight, time_s).position_w_m[2]) + 0.7
    standing = replace(flight, still_since_s=time_s)
    assert told(standing, staying_up(flight, time_s, above_m)) == set()
    below_m = above_m - 1.4
    assert Fault.TRACKING_ERROR in told(standing, staying_up(flight, time_s, below_m)), "that is no standing"


def test_frames_dropped_on_their_way_are_known() -> None:
    flight, time_s = STATES["hovering"]
    cycles = [cycle(time_s + k * CYCLE_S, np.add(GROUND, (0.0, 0.0, 1.2)), late=k // 2) for k in range(2 * SLOW)]
    assert told(flight, cycles) == {Fault.MOCAP_OUT_OF_ORDER}


def test_the_facts_tell_what_the_autopilot_and_the_last_setpoint_say() -> None:
    status = replace(healthy(0).autopilot, in_air=False)
    events = (Event(Fault.ARMS, "an arm"),)
    for vehicle in (None, healthy(0).mocap.vehicle):
        known = facts_of(5.0, vehicle, status, None, events, 0.25)
        assert (known.in_air, known.thrust, known.events) == (False, 0.25, events)
        assert math.isnan(facts_of(5.0, vehicle, status, None, events).thrust), "not known"
