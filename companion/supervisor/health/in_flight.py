"""Law, loop, thrust, arms, the time things take, and what the flight leans on. Pure."""

from dataclasses import field
from math import isfinite

from companion.core.values import value
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NEVER, Window, since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

LATE_WINDOW_S = 1.0
"""Over which the cycles' lateness is averaged."""


@value
class FlightHealth:
    """What is remembered."""

    saturated_since_s: float = NEVER
    begun_s: float = NEVER
    """The first cycle."""
    late: Window = field(default_factory=Window)
    """How late (s) the cycles of the last second began."""


def look_at_flight(memory: FlightHealth, now: HealthInputs, rules: SafetyRules) -> tuple[FlightHealth, list[Event]]:
    """All that needs no motion capture and no autopilot."""
    late = memory.late.kept(now.time_s - LATE_WINDOW_S)
    memory = FlightHealth(
        since(memory.saturated_since_s, now.airborne and now.at_max_thrust, now.time_s),
        since(memory.begun_s, True, now.time_s),
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
    return memory, events + _of_times(now, rules)


def _of_times(now: HealthInputs, rules: SafetyRules) -> list[Event]:
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
