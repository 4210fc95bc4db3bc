"""Health checks of the position: tracking error and fence. Pure."""

from dataclasses import field
from math import dist

import numpy as np

from companion.core.values import value
from companion.estimation.state import Verdict
from companion.guard.geofence import Fence
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NOT_HELD, Window, held_since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

GROWN_M = 0.1
"""Least growth of a growing error within the time it is checked; less is a steady error's noise."""
SHRUNK_M = 0.02
"""An error that decreases by this much does not count as growing."""


@value
class PositionHealth:
    """Memory of the position checks."""

    far_since_s: float = NOT_HELD
    errors: Window = field(default_factory=Window)
    """Distances from the reference (m) since they became large."""
    seen_inside: bool = False
    """The pose was inside the fence during this flight, or is inside before it."""
    doubted: bool = False
    """The pose jumped while armed: it must never be the reason to stop the motors."""


def check_position(
    memory: PositionHealth, now: HealthInputs, rules: SafetyRules, fence: Fence, new: bool
) -> tuple[PositionHealth, list[Event]]:
    """Check tracking error and fence; `new`: this cycle has a new frame."""
    far_since_s, errors, tracking = _tracking_events(memory, now, rules)
    beyond_m, seen_inside = None, memory.seen_inside and now.autopilot.armed
    vehicle = now.mocap.vehicle
    if vehicle is not None and now.mocap.age_s < rules.silent_s:
        beyond_m = fence.beyond_m(vehicle.position_w_m)
        seen_inside = seen_inside or beyond_m <= 0.0
    doubted = now.autopilot.armed and (memory.doubted or (new and now.mocap.verdict is Verdict.STARTED))
    memory = PositionHealth(far_since_s, errors, seen_inside, doubted)
    return memory, tracking + _fence_events(memory, now, beyond_m, rules, fence)


def _tracking_events(
    memory: PositionHealth, now: HealthInputs, rules: SafetyRules
) -> tuple[float, Window, list[Event]]:
    vehicle, reference = now.mocap.vehicle, now.reference_w_m
    if vehicle is None or reference is None or not now.airborne or not now.mocap.age_s < rules.degraded_s:
        return NOT_HELD, Window(), []
    error_m = dist(vehicle.position_w_m.tolist(), reference.tolist())
    if not error_m > rules.tracking_m:
        return NOT_HELD, Window(), []
    far_since_s = held_since(memory.far_since_s, True, now.time_s)
    errors = memory.errors.added(now.time_s, error_m)
    events = []
    if now.time_s - far_since_s >= rules.tracking_s:
        events.append(Event(Fault.TRACKING_ERROR, f"{error_m:.2f} m from the reference"))
    if error_m > rules.lost_m:
        events.append(Event(Fault.TRACKING_LOST, f"{error_m:.2f} m from the reference"))
    elif now.time_s - far_since_s >= rules.growing_s and _grows(errors):
        events.append(Event(Fault.TRACKING_LOST, f"{error_m:.2f} m from the reference, and growing"))
    return far_since_s, errors.kept(now.time_s - rules.growing_s), events


def _grows(errors: Window) -> bool:
    """Return true if the errors grow by more than noise, without decreasing in between."""
    most_m = 0.0
    for error_m in errors.numbers:
        if error_m < most_m - SHRUNK_M:
            return False
        most_m = max(most_m, error_m)
    return errors.numbers[-1] - errors.numbers[0] > GROWN_M


def _fence_events(
    memory: PositionHealth, now: HealthInputs, beyond_m: float | None, rules: SafetyRules, fence: Fence
) -> list[Event]:
    vehicle = now.mocap.vehicle
    if vehicle is None or beyond_m is None or not now.autopilot.armed:
        return []
    if not beyond_m > 0.0:
        stop_w_m = fence.stopping_point_w_m(vehicle.position_w_m, vehicle.velocity_w_mps)
        if not fence.beyond_m(np.array(stop_w_m)) > 0.0:
            return []
        return [Event(Fault.FENCE_NEAR, f"{-beyond_m:.2f} m inside the fence and too fast to stop there")]
    events = [Event(Fault.FENCE_LEFT, f"{beyond_m:.2f} m outside the fence")]
    if beyond_m > rules.beyond_m and memory.seen_inside and not memory.doubted:
        events.append(Event(Fault.ROOM_LEFT, f"{beyond_m:.2f} m outside the fence with turning motors"))
    return events
