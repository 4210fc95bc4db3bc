"""Health checks of law, loop, thrust, arms, phase durations, broker and disk. Pure."""

from dataclasses import field
from math import hypot, inf, isfinite

from companion.core.values import value
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NOT_HELD, Window, held_since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.separation import SeparationRules

LATE_WINDOW_S = 1.0
"""Window over which the cycles' delay is averaged."""


@value
class FlightHealth:
    """Memory of the flight checks."""

    saturated_since_s: float = NOT_HELD
    begun_s: float = NOT_HELD
    """Begin of the first cycle."""
    above_another_s: float = -inf
    """Time at which this vehicle, landing, was last above another one; -inf before."""
    late: Window = field(default_factory=Window)
    """Delays (s) with which the cycles of the last second began."""


def check_flight(
    memory: FlightHealth, now: HealthInputs, rules: SafetyRules, separation: SeparationRules | None
) -> tuple[FlightHealth, list[Event]]:
    """Check everything that needs neither motion capture nor autopilot."""
    late = memory.late.kept(now.time_s - LATE_WINDOW_S)
    memory = FlightHealth(
        held_since(memory.saturated_since_s, now.airborne and now.at_max_thrust, now.time_s),
        held_since(memory.begun_s, True, now.time_s),
        now.time_s if _is_above_another(now, rules, separation) else memory.above_another_s,
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
    return memory, events + _duration_events(now, rules, memory.above_another_s)


def _is_above_another(now: HealthInputs, rules: SafetyRules, separation: SeparationRules | None) -> bool:
    """Return True if another vehicle is below one that lands, so near that the guard may stop the descent for it."""
    vehicle = now.mocap.vehicle
    if separation is None or vehicle is None or not isfinite(now.landing_due_s):
        return False
    x, y, z = vehicle.position_w_m.tolist()
    radius_m = separation.cylinder.radius_m + rules.traffic_margin_m
    places = [other.position_w_m for other in now.others if other.known]
    return any(oz < z and hypot(ox - x, oy - y) < radius_m for ox, oy, oz in places)


def _duration_events(now: HealthInputs, rules: SafetyRules, above_another_s: float) -> list[Event]:
    events = []
    overdue_s, held_s = now.time_s - now.landing_due_s, now.time_s - now.held_by_fault_since_s
    waited_s = min(max(above_another_s - now.landing_due_s, 0.0), rules.landing_above_s)
    if overdue_s - waited_s > rules.landing_s:
        events.append(Event(Fault.LANDING_TOO_LONG, f"the landing is {overdue_s:.0f} s overdue"))
    if held_s > rules.hold_s:
        events.append(Event(Fault.HOLD_TOO_LONG, f"held by a fault for {held_s:.0f} s"))
    if now.operator_age_s > rules.operator_gone_s:
        events.append(Event(Fault.OPERATOR_GONE, f"no broker for {now.operator_age_s:.1f} s"))
    if now.disk_free_mb < rules.disk_free_mb:
        text = f"{now.disk_free_mb:.0f} MB free for records, less than {rules.disk_free_mb:g} MB"
        events.append(Event(Fault.DISK_FULL, text))
    return events
