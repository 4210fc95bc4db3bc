"""Health checks of the other vehicles: predicted paths, blocked ways, lost separation, unseen bodies. Pure."""

from math import hypot

from companion.core.types import OtherVehicle, Vec3
from companion.core.values import value
from companion.supervisor.faults import Event, Fault, Stage
from companion.supervisor.health.memory import NOT_HELD, held_since
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules
from companion.supervisor.separation import (
    NEARER_M,
    STEP_S,
    SeparationRules,
    least_gap_m,
    stopped,
    stopping_path,
)

_CLEAR_M = 0.1
"""Distance beyond the yield margin at which a way is no longer blocked: noise at its edge must not begin it again."""

_BETTER_M = 0.1
"""Distance that a hold must gain: a vehicle that hovers gains none by it, and noise less."""


@value
class SeparationHealth:
    """Memory of the separation checks."""

    seen: frozenset[str] = frozenset()
    """Bodies seen since the vehicle was armed; those seen now before it is."""
    blocked_since_s: float = NOT_HELD


def check_separation(
    memory: SeparationHealth, now: HealthInputs, rules: SafetyRules, separation: SeparationRules | None
) -> tuple[SeparationHealth, list[Event]]:
    """Check the other vehicles while the autopilot is armed; nothing without any."""
    if separation is None or not now.others:
        return SeparationHealth(), []
    in_sight = frozenset(other.body for other in now.others if not other.unseen_s > rules.other_unseen_s)
    if not now.autopilot.armed:
        return SeparationHealth(seen=in_sight), []
    seen, events = memory.seen | in_sight, []
    for other in now.others:
        if other.body in seen - in_sight:
            events.append(Event(Fault.OTHER_UNSEEN, f"{other.body!r} has not been seen for {other.unseen_s:.1f} s"))
    own = _own(now, rules)
    if own is None:
        return SeparationHealth(seen, memory.blocked_since_s), events
    known = [other for other in now.others if other.known]
    blocked = [other for other in known if _blocks(other, own, memory, now, rules, separation)]
    blocked_since_s = held_since(memory.blocked_since_s, bool(blocked), now.time_s)
    if now.time_s - blocked_since_s >= rules.yield_s:
        text = f"{blocked[0].body!r}, which goes first, has been in the way for {now.time_s - blocked_since_s:.1f} s"
        events.append(Event(Fault.TRAFFIC_BLOCKED, text))
    for other in known:
        events += _near(other, own, now, rules, separation)
    return SeparationHealth(seen, blocked_since_s), events


def _own(now: HealthInputs, rules: SafetyRules) -> tuple[Vec3, Vec3] | None:
    """Return this vehicle's position and velocity; None while they are not known."""
    vehicle = now.mocap.vehicle
    if vehicle is None or not now.mocap.age_s < rules.degraded_s:
        return None
    return tuple(vehicle.position_w_m.tolist()), tuple(vehicle.velocity_w_mps.tolist())


def _blocks(
    other: OtherVehicle,
    own: tuple[Vec3, Vec3],
    memory: SeparationHealth,
    now: HealthInputs,
    rules: SafetyRules,
    separation: SeparationRules,
) -> bool:
    """Return True if this vehicle is in the way of one that goes first and flies, and does not leave."""
    if other.body not in separation.first or other.parked or not now.airborne:
        return False
    wide = separation.cylinder.widened(rules.yield_margin_m)
    clear_m = _CLEAR_M if memory.blocked_since_s < NOT_HELD else 0.0
    if wide.gap_m(own[0], other) >= clear_m:
        return False
    leaves = bool(now.path_w_m) and wide.gap_m(now.path_w_m[-1], other) >= clear_m
    return not leaves


def _near(
    other: OtherVehicle, own: tuple[Vec3, Vec3], now: HealthInputs, rules: SafetyRules, separation: SeparationRules
) -> list[Event]:
    where = _where(other, own[0])
    if now.taking_off and not other.parked and _comes_over(other, own[0], rules, separation):
        return [Event(Fault.SEPARATION_LOST, f"{where}, and comes near before the takeoff")]
    stands = not now.airborne and now.autopilot.in_air is not True
    cylinder = separation.cylinder.lowered if stands else separation.cylinder
    if cylinder.gap_m(own[0], other) < 0.0:
        measured = not other.unseen_s > rules.degraded_s
        later = (separation.yields_to(other) and measured) or not now.airborne
        return [Event(Fault.SEPARATION_LOST if later else Fault.TRAFFIC, f"{where}: inside its cylinder")]
    if now.stage is not Stage.FLYING or not now.airborne:
        return []
    if _rests_too_near(other, own, now, rules, separation) or (
        separation.yields_to(other) and _meets(other, own, now, rules, separation)
    ):
        return [Event(Fault.TRAFFIC, f"{where}, and the ways meet")]
    return []


def _comes_over(other: OtherVehicle, own_w_m: Vec3, rules: SafetyRules, separation: SeparationRules) -> bool:
    """Return True if another one is, or soon will be, where a takeoff would lead into its yield margin."""
    stays = (own_w_m,) * (round(rules.yield_ahead_s / STEP_S) + 1)
    return least_gap_m(stays, other, separation.cylinder.widened(rules.yield_margin_m)) < -NEARER_M


def _where(other: OtherVehicle, own_w_m: Vec3) -> str:
    (x, y, z), (ox, oy, oz) = own_w_m, other.position_w_m
    level = "lower" if oz < z else "higher"
    return f"{other.body!r} is {hypot(ox - x, oy - y):.2f} m away and {abs(oz - z):.2f} m {level}"


def _rests_too_near(
    other: OtherVehicle, own: tuple[Vec3, Vec3], now: HealthInputs, rules: SafetyRules, separation: SeparationRules
) -> bool:
    """Return True if the vehicle, braking now, would come to rest too near the other, which brakes, too."""
    margin_m = rules.yield_margin_m if separation.yields_to(other) else rules.traffic_margin_m
    wide = separation.cylinder.widened(margin_m)
    gaps = [
        wide.gap_between_m(now.rest_w_m, there, other.parked)
        for there in (other.position_w_m, stopped(other, separation.cylinder))
    ]
    return min(gaps) < 0.0 and gaps[0] < wide.gap_m(own[0], other) - NEARER_M


def _from(own_w_m: Vec3, path_w_m: tuple[Vec3, ...]) -> tuple[Vec3, ...]:
    """Return the way ahead from where the vehicle is: the guard may have pushed it away from its reference.

    By the reference alone, a way out of the margin would seem to begin nearer to the other vehicle, and be held.
    """
    dx, dy, dz = (here - begin for here, begin in zip(own_w_m, path_w_m[0], strict=True))
    return tuple((x + dx, y + dy, z + dz) for x, y, z in path_w_m)


def _meets(
    other: OtherVehicle, own: tuple[Vec3, Vec3], now: HealthInputs, rules: SafetyRules, separation: SeparationRules
) -> bool:
    """Return True if the way ahead meets the other's, and holding keeps farther away than going on."""
    wide = separation.cylinder.widened(rules.yield_margin_m)
    if not now.path_w_m:
        return False
    on_m = least_gap_m(_from(own[0], now.path_w_m), other, wide)
    if not on_m < min(0.0, wide.gap_m(own[0], other) - NEARER_M):
        return False
    held = stopping_path(*own, separation.cylinder, rules.yield_ahead_s)
    return least_gap_m(held, other, wide) > on_m + _BETTER_M
