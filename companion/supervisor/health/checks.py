"""The health checks: from what is known to the faults that are there now. Pure; runs in every cycle.

What each fault is and what follows from it stands in faults.TABLE; the checks themselves in health_mocap (is there a
pose), health_stream (how good is the stream), health_attitude, health_place, health_autopilot and health_flight.
LIFT_OFF_UNSEEN, OFFBOARD_REFUSED, SERVICE_TWICE, LOOP_STOPPED, ABORT and KILL are seen where they happen, not here.
"""

from dataclasses import dataclass, field
from math import nan

from companion.guard.geofence import Fence
from companion.supervisor.faults import TABLE, Event, Fault
from companion.supervisor.health.attitude import AttitudeHealth, look_at_attitude
from companion.supervisor.health.autopilot import AutopilotHealth, look_at_autopilot
from companion.supervisor.health.in_flight import FlightHealth, look_at_flight
from companion.supervisor.health.mocap import MocapHealth, look_at_mocap
from companion.supervisor.health.position import PlaceHealth, look_at_place
from companion.supervisor.health.stream import StreamHealth, look_at_stream
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

_OUR_LANDING = {Fault.TRACKING_LOST: Fault.TRACKING_ERROR, Fault.BATTERY_CRITICAL: Fault.BATTERY_LOW}
"""What PX4 would be told to land for, and which fault the same is when we have to."""
_ORDER = {row.fault: place for place, row in enumerate(TABLE)}


@dataclass(frozen=True)
class Health:
    """Everything the checks remember; `Health()` is the beginning."""

    received_s: float = nan
    """Arrival of the newest frame; NaN before the first. Its number would not do: some QTM versions count none."""
    mocap: MocapHealth = field(default_factory=MocapHealth)
    stream: StreamHealth = field(default_factory=StreamHealth)
    attitude: AttitudeHealth = field(default_factory=AttitudeHealth)
    place: PlaceHealth = field(default_factory=PlaceHealth)
    autopilot: AutopilotHealth = field(default_factory=AutopilotHealth)
    flight: FlightHealth = field(default_factory=FlightHealth)


def assess(memory: Health, now: HealthInputs, rules: SafetyRules, fence: Fence) -> tuple[Health, tuple[Event, ...]]:
    """What is wrong now, in the table's order, each fault at most once; and what to remember for the next cycle."""
    new = now.seen.verdict is not None and now.seen.received_s != memory.received_s
    mocap, of_mocap = look_at_mocap(memory.mocap, now, rules, new)
    stream, of_stream = look_at_stream(memory.stream, now, rules, new)
    attitude, of_attitude = look_at_attitude(memory.attitude, now, rules)
    place, of_place = look_at_place(memory.place, now, rules, fence, new)
    autopilot, of_autopilot = look_at_autopilot(memory.autopilot, now, rules)
    flight, of_flight = look_at_flight(memory.flight, now, rules)
    found = of_mocap + of_stream + of_attitude + of_place + of_autopilot + of_flight
    if attitude.horizon_wrong:
        found = _without_autopilot(found)
    events = {event.fault: event for event in found}.values()
    memory = Health(now.seen.received_s, mocap, stream, attitude, place, autopilot, flight)
    return memory, tuple(sorted(events, key=lambda event: _ORDER[event.fault])) if events else ()


def _without_autopilot(found: list[Event]) -> list[Event]:
    """What all this means while PX4 would land by a wrong horizon: our landing goes on, or ends before the fence."""
    found = [Event(_OUR_LANDING.get(event.fault, event.fault), event.text) for event in found]
    at_fence = [event.text for event in found if event.fault in {Fault.FENCE_NEAR, Fault.FENCE_LEFT}]
    return found + [Event(Fault.HORIZON_LOST, f"{text}, by a wrong horizon") for text in at_fence]
