"""Is the vehicle where it should be, and inside its fence. Pure."""

from dataclasses import field
from math import dist

import numpy as np

from companion.core.values import value
from companion.estimation.state import Verdict
from companion.guard.geofence import Fence
from companion.supervisor.faults import Event, Fault
from companion.supervisor.health.memory import NEVER, Window, since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules

GROWN_M = 0.1
"""An error that grows has grown by this much in the time it is looked at; less is a steady error's noise."""
SHRUNK_M = 0.02
"""An error that falls back by this much does not grow."""


@value
class PlaceHealth:
    """What is remembered."""

    far_since_s: float = NEVER
    errors: Window = field(default_factory=Window)
    """Distances from the reference (m) since they are large."""
    seen_inside: bool = False
    """The pose was inside the fence in this flight, or is before it."""
    doubted: bool = False
    """The pose jumped while the motors turned: it must never be the reason to stop them."""


def look_at_place(
    memory: PlaceHealth, now: HealthInputs, rules: SafetyRules, fence: Fence, new: bool
) -> tuple[PlaceHealth, list[Event]]:
    """`new`: this cycle brought a frame."""
    far_since_s, errors, tracking = _of_tracking(memory, now, rules)
    beyond_m, seen_inside = None, memory.seen_inside and now.autopilot.armed
    vehicle = now.seen.vehicle
    if vehicle is not None and now.seen.age_s < rules.silent_s:
        beyond_m = fence.beyond_m(vehicle.position_w_m)
        seen_inside = seen_inside or beyond_m <= 0.0
    doubted = now.autopilot.armed and (memory.doubted or (new and now.seen.verdict is Verdict.STARTED))
    memory = PlaceHealth(far_since_s, errors, seen_inside, doubted)
    return memory, tracking + _of_fence(memory, now, beyond_m, rules, fence)


def _of_tracking(memory: PlaceHealth, now: HealthInputs, rules: SafetyRules) -> tuple[float, Window, list[Event]]:
    vehicle, reference = now.seen.vehicle, now.reference_w_m
    if vehicle is None or reference is None or not now.airborne or not now.seen.age_s < rules.degraded_s:
        return NEVER, Window(), []
    error_m = dist(vehicle.position_w_m.tolist(), reference.tolist())
    if not error_m > rules.tracking_m:
        return NEVER, Window(), []
    far_since_s = since(memory.far_since_s, True, now.time_s)
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
    """By a clear amount, and without falling back on the way."""
    most_m = 0.0
    for error_m in errors.numbers:
        if error_m < most_m - SHRUNK_M:
            return False
        most_m = max(most_m, error_m)
    return errors.numbers[-1] - errors.numbers[0] > GROWN_M


def _of_fence(
    memory: PlaceHealth, now: HealthInputs, beyond_m: float | None, rules: SafetyRules, fence: Fence
) -> list[Event]:
    vehicle = now.seen.vehicle
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
