"""Observed flights for the tests of the health checks: a healthy hover, of which a test changes what it is about.

Times are multiples of 1/128 s, so that sums of them are exact and a limit can be met to the last bit.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from companion.core.types import Array, AttitudeThrust, AutopilotStatus, FlightMode, VehicleState
from companion.estimation.state import Verdict
from companion.geometry.frames import quat_multiply
from companion.guard.geofence import Fence
from companion.supervisor.faults import Event, Fault, Stage
from companion.supervisor.health.checks import Health, assess
from companion.supervisor.health_inputs import HealthInputs, MocapInputs
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.separation import SeparationRules

CYCLE_S = 1.0 / 128.0
START_S = 1000.0
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
FENCE = Fence((-4.0, -4.0), (4.0, 4.0, 3.0), braking_mps2=2.0, reaction_s=0.5)
RULES = SafetyRules(
    coast_s=0.0625,
    degraded_s=0.125,
    silent_s=0.25,
    frozen_s=0.125,
    delayed_s=0.0625,
    out_of_order_share=0.25,
    clock_jump_s=0.125,
    heading_apart_rad=0.375,
    apart_s=0.25,
    not_followed_rad=0.25,
    not_followed_s=0.5,
    tracking_s=0.25,
    growing_s=0.5,
    saturated_s=0.75,
    loop_late_s=1.0 / 64.0,
    battery_critical=0.125,
)
"""The usual ones, but as binary fractions."""

Change = Callable[[HealthInputs], HealthInputs]


def healthy(cycle: int, position: tuple[float, float, float] = (0.5, -0.25, 1.0)) -> HealthInputs:
    """One cycle of a hover: a frame came in it and was used."""
    time_s = START_S + cycle * CYCLE_S
    place = np.array(position)
    vehicle = VehicleState(time_s - 1.0 / 64.0, place, np.zeros(3), LEVEL, np.zeros(3))
    seen = MocapInputs(
        age_s=1.0 / 64.0,
        verdict=Verdict.ACCEPTED,
        frame=cycle,
        stamp_s=7.0 + cycle * CYCLE_S,
        received_s=time_s,
        vehicle=vehicle,
    )
    status = AutopilotStatus(
        connected=True,
        heartbeat_s=time_s,
        armed=True,
        mode=FlightMode.OFFBOARD,
        in_air=True,
        battery_fraction=0.75,
        battery_v=15.0,
        q_w_flu_wxyz=LEVEL,
        last_text="",
        heard_s=time_s,
        attitude_s=time_s,
        boot_s=50.0 + time_s,
    )
    sent = AttitudeThrust(LEVEL, np.array(0.5))
    return HealthInputs(
        time_s=time_s,
        stage=Stage.FLYING,
        commanded=True,
        streaming=True,
        airborne=True,
        mocap=seen,
        autopilot=status,
        reference_w_m=place,
        sent=sent,
        at_max_thrust=False,
        law_fault="",
        late_s=0.0,
        landing_due_s=math.inf,
        held_by_fault_since_s=math.inf,
        land_asked_s=math.inf,
        arm_fault="",
        horizon_fault="",
        operator_age_s=0.0,
        disk_free_mb=1e4,
    )


def with_seen(now: HealthInputs, **changes: Any) -> HealthInputs:
    """Motion capture seen differently."""
    return replace(now, mocap=replace(now.mocap, **changes))


def with_vehicle(now: HealthInputs, **changes: Any) -> HealthInputs:
    """The estimate differently."""
    assert now.mocap.vehicle is not None
    return with_seen(now, vehicle=replace(now.mocap.vehicle, **changes))


def with_status(now: HealthInputs, **changes: Any) -> HealthInputs:
    """The autopilot differently."""
    return replace(now, autopilot=replace(now.autopilot, **changes))


def on_ground(now: HealthInputs) -> HealthInputs:
    """Before arming, nothing sent."""
    now = replace(now, stage=Stage.GROUND, commanded=False, streaming=False, airborne=False, reference_w_m=None)
    return replace(with_status(now, armed=False, mode=FlightMode.HOLD, in_air=False), sent=None)


def standing(now: HealthInputs) -> HealthInputs:
    """With turning rotors, commanded by us, before lift-off."""
    now = replace(now, stage=Stage.GROUND, airborne=False, reference_w_m=None)
    return with_status(now, in_air=False)


def handed_over(now: HealthInputs) -> HealthInputs:
    """The autopilot lands by itself, on the poses it is given."""
    now = replace(now, stage=Stage.HANDED_OVER, commanded=False, streaming=False, airborne=False, reference_w_m=None)
    return replace(with_status(now, mode=FlightMode.LAND), sent=None)


def watched(
    flight: Iterator[HealthInputs] | list[HealthInputs],
    rules: SafetyRules = RULES,
    fence: Fence = FENCE,
    separation: SeparationRules | None = None,
) -> list[tuple[Event, ...]]:
    """The events of each cycle."""
    memory, events = Health(), []
    for now in flight:
        memory, found = assess(memory, now, rules, fence, separation=separation)
        events.append(found)
    return events


def faults(events: tuple[Event, ...]) -> list[Fault]:
    """Without their texts."""
    return [event.fault for event in events]


def text_of(events: tuple[Event, ...], fault: Fault) -> str:
    """Return the text of the one event of this fault."""
    (text,) = [event.text for event in events if event.fault is fault]
    return text


def tilted(x_rad: float, y_rad: float = 0.0, yaw_rad: float = 0.0) -> Array:
    """Turned about world x, then y, then z: attitude (4,)."""
    roll = np.array([math.cos(x_rad / 2), math.sin(x_rad / 2), 0.0, 0.0])
    pitch = np.array([math.cos(y_rad / 2), 0.0, math.sin(y_rad / 2), 0.0])
    yaw = np.array([math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)])
    return quat_multiply(yaw, quat_multiply(pitch, roll))
