"""Way ahead of the vehicle as its reference has it, for the checks of the other vehicles. Pure."""

import math
from collections.abc import Iterable

from companion.core.types import Array, OtherVehicle, Vec3, VehicleState
from companion.core.values import value
from companion.guard.separation import Separation
from companion.supervisor.flight_state import FlightState
from companion.supervisor.separation import STEP_S, SeparationRules
from companion.supervisor.transitions import reference_at, resting_place

_SPEED_MPS = 1.0
"""Speed that a vehicle at rest may take up within the time looked ahead."""
_SPARE_M = 1.0
"""Widest margin around a cylinder, and more."""


@value
class WayAhead:
    """Reference positions from now on, and where the vehicle would come to rest."""

    path_w_m: tuple[Vec3, ...] = ()
    """A point every STEP_S; empty where this vehicle yields to none in reach."""
    rest_w_m: Vec3 = (math.nan, math.nan, math.nan)
    """As far from the reference's own resting place as the vehicle is from its reference: the guard may have pushed it.

    NaN where no other vehicle is in reach.
    """


NO_WAY = WayAhead()


def way_ahead(
    flight: FlightState,
    time_s: float,
    vehicle: VehicleState,
    others: Iterable[OtherVehicle],
    rules: SeparationRules,
    ahead_s: float,
) -> WayAhead:
    """Return the way ahead of a flying vehicle, as far as another one could be met within `ahead_s`.

    Its points take 10 us each.
    """
    near = [other for other in others if _in_reach(other, vehicle, rules.cylinder, ahead_s)]
    if not near:
        return NO_WAY
    now = reference_at(flight, time_s)
    _, rest_w_m = resting_place(now, rules.cylinder.braking_mps2)
    rest = vehicle.position_w_m + (rest_w_m - now.position_w_m)
    yields = any(rules.yields_to(other) for other in near)
    times_s = [time_s + index * STEP_S for index in range(round(ahead_s / STEP_S) + 1)] if yields else []
    return WayAhead(tuple(_floats(reference_at(flight, at_s).position_w_m) for at_s in times_s), _floats(rest))


def _in_reach(other: OtherVehicle, vehicle: VehicleState, cylinder: Separation, ahead_s: float) -> bool:
    speed_mps = max(math.hypot(*vehicle.velocity_w_mps.tolist()), _SPEED_MPS) + math.hypot(*other.velocity_w_mps)
    return other.known and cylinder.gap_m(_floats(vehicle.position_w_m), other) < speed_mps * ahead_s + _SPARE_M


def _floats(place: Array) -> Vec3:
    x, y, z = place.tolist()
    return x, y, z
