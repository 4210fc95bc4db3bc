"""Entry point of the health checks: from one cycle's inputs to the faults present now. Pure.

faults.TABLE defines each fault and its failsafe actions. LIFT_OFF_UNSEEN, OFFBOARD_REFUSED, SERVICE_TWICE,
LOOP_STOPPED, ABORT and KILL are detected elsewhere, where they happen.
"""

from dataclasses import dataclass, field
from math import nan

from companion.guard.geofence import Fence
from companion.supervisor.faults import TABLE, Event, Fault
from companion.supervisor.health.attitude import AttitudeHealth, check_attitude
from companion.supervisor.health.autopilot import AutopilotHealth, check_autopilot
from companion.supervisor.health.in_flight import FlightHealth, check_flight
from companion.supervisor.health.law_link import check_law_link
from companion.supervisor.health.mocap import MocapHealth, check_mocap
from companion.supervisor.health.position import PositionHealth, check_position
from companion.supervisor.health.separation import SeparationHealth, check_separation
from companion.supervisor.health.stream import StreamHealth, check_stream
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.separation import SeparationRules

_OUR_LANDING = {Fault.TRACKING_LOST: Fault.TRACKING_ERROR, Fault.BATTERY_CRITICAL: Fault.BATTERY_LOW}
"""Faults that let PX4 land, and the fault each becomes when our controller must land instead."""
_ORDER = {row.fault: index for index, row in enumerate(TABLE)}


@dataclass(frozen=True, kw_only=True)
class Health:
    """Memory of all health checks; `Health()` is the initial value."""

    received_s: float = nan
    """Arrival of the newest frame; NaN before the first. Some QTM versions do not count frames."""
    mocap: MocapHealth = field(default_factory=MocapHealth)
    stream: StreamHealth = field(default_factory=StreamHealth)
    attitude: AttitudeHealth = field(default_factory=AttitudeHealth)
    position: PositionHealth = field(default_factory=PositionHealth)
    autopilot: AutopilotHealth = field(default_factory=AutopilotHealth)
    flight: FlightHealth = field(default_factory=FlightHealth)
    separation: SeparationHealth = field(default_factory=SeparationHealth)


def assess(
    memory: Health,
    now: HealthInputs,
    rules: SafetyRules,
    fence: Fence,
    off: frozenset[Fault] = frozenset(),
    separation: SeparationRules | None = None,
) -> tuple[Health, tuple[Event, ...]]:
    """Return the checks' next memory and the faults present now, in the table's order, each at most once.

    Faults that are `off` are not reported, and have no part in what is. `separation` is None in a room of one vehicle.
    """
    new = now.mocap.verdict is not None and now.mocap.received_s != memory.received_s
    mocap, mocap_events = check_mocap(memory.mocap, now, rules, new)
    stream, stream_events = check_stream(memory.stream, now, rules, new)
    attitude, attitude_events = check_attitude(memory.attitude, now, rules)
    position, position_events = check_position(memory.position, now, rules, fence, new)
    autopilot, autopilot_events = check_autopilot(memory.autopilot, now, rules)
    flight, flight_events = check_flight(memory.flight, now, rules, separation)
    apart, traffic_events = check_separation(memory.separation, now, rules, separation)
    found = mocap_events + stream_events + attitude_events + position_events + traffic_events
    found += autopilot_events + flight_events
    found += check_law_link(now, rules)
    found = [event for event in found if event.fault not in off]
    if attitude.horizon_wrong and Fault.HORIZON_WRONG not in off:
        found = _without_autopilot(found)
    events = {event.fault: event for event in found}.values()
    memory = Health(
        received_s=now.mocap.received_s,
        mocap=mocap,
        stream=stream,
        attitude=attitude,
        position=position,
        autopilot=autopilot,
        flight=flight,
        separation=apart,
    )
    return memory, tuple(sorted(events, key=lambda event: _ORDER[event.fault])) if events else ()


def _without_autopilot(found: list[Event]) -> list[Event]:
    """Replace the events that hand over to PX4, which would land by a wrong horizon: we land, or stop at the fence."""
    found = [Event(_OUR_LANDING.get(event.fault, event.fault), event.text) for event in found]
    at_fence = [event.text for event in found if event.fault in {Fault.FENCE_NEAR, Fault.FENCE_LEFT}]
    return found + [Event(Fault.HORIZON_LOST, f"{text}, by a wrong horizon") for text in at_fence]
