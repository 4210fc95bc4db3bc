"""Health checks of law, loop, thrust, arms, phase durations, broker and disk. Pure."""

from dataclasses import field
from math import isfinite

from companion.core.values import value
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NOT_HELD, Window, held_since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

LATE_WINDOW_S = 1.0
"""Window over which the cycles' delay is averaged."""


@value
class FlightHealth:
    """Memory of the flight checks."""

    saturated_since_s: float = NOT_HELD
    begun_s: float = NOT_HELD
    """Begin of the first cycle."""
    late: Window = field(default_factory=Window)
    """Delays (s) with which the cycles of the last second began."""


def check_flight(memory: FlightHealth, now: HealthInputs, rules: SafetyRules) -> tuple[FlightHealth, list[Event]]:
    """Check everything that needs neither motion capture nor autopilot."""
    late = memory.late.kept(now.time_s - LATE_WINDOW_S)
    memory = FlightHealth(
        held_since(memory.saturated_since_s, now.airborne and now.at_max_thrust, now.time_s),
        held_since(memory.begun_s, True, now.time_s),
        late.added(now.time_s, now.late_s) if isfinite(now.late_s) else late,
    )
    events = []
    saturated_s = now.time_s - memory.saturated_since_s
    if saturated_s >= rules.saturated_s:
        events.append(Event(Fault.THRUST_SATURATED, f"thrust at its upper limit for {saturated_s:.1f} s"))
    if now.law_fault:
        events.append(Event(Fault.LAW_FAILED, now.law_fault))
    cycles = len(memory.late.times_s)
    if now.time_s - memory.begun_s >= LATE_WINDOW_S and memory.late.total > rules.loop_late_s * cycles:
        text = f"control cycles begin {memory.late.total / cycles:.3f} s late on average"
        events.append(Event(Fault.LOOP_LATE, text))
    if now.arm_fault:
        events.append(Event(Fault.ARMS, now.arm_fault))
    if now.horizon_fault:
        events.append(Event(Fault.HORIZON_CAPPED, now.horizon_fault))
    return memory, events + _duration_events(now, rules)


def _duration_events(now: HealthInputs, rules: SafetyRules) -> list[Event]:
    events = []
    overdue_s, held_s = now.time_s - now.landing_due_s, now.time_s - now.held_by_fault_since_s
    if overdue_s > rules.landing_s:
        events.append(Event(Fault.LANDING_TOO_LONG, f"the landing is {overdue_s:.0f} s overdue"))
    if held_s > rules.hold_s:
        events.append(Event(Fault.HOLD_TOO_LONG, f"held by a fault for {held_s:.0f} s"))
    if now.operator_age_s > rules.operator_gone_s:
        events.append(Event(Fault.OPERATOR_GONE, f"no broker for {now.operator_age_s:.1f} s"))
    if now.disk_free_mb < rules.disk_free_mb:
        text = f"{now.disk_free_mb:.0f} MB free for records, less than {rules.disk_free_mb:g} MB"
        events.append(Event(Fault.DISK_FULL, text))
    return events
