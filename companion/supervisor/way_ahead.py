"""Way ahead of the vehicle as its reference has it, for the checks of the other vehicles. Pure."""

import math
from collections.abc import Iterable

from companion.core.types import Array, OtherVehicle, Vec3, VehicleState
from companion.core.values import value
from companion.guard.separation import Separation
from companion.supervisor.flight_state import FlightState
from companion.supervisor.separation import STEP_S
from companion.supervisor.transitions import reference_at, resting_place

_SPEED_MPS = 1.0
"""Speed that a vehicle at rest may take up within the time looked ahead."""
_SPARE_M = 1.0
"""Widest margin around a cylinder, and more."""


@value
class WayAhead:
    """Reference positions from now on, and where the reference would come to rest."""

    path_w_m: tuple[Vec3, ...] = ()
    rest_w_m: Vec3 = (math.nan, math.nan, math.nan)


NO_WAY = WayAhead()


def way_ahead(flight: FlightState, time_s: float, cylinder: Separation, ahead_s: float) -> WayAhead:
    """Return the way ahead of a flying vehicle for so long."""
    times_s = [time_s + index * STEP_S for index in range(round(ahead_s / STEP_S) + 1)]
    path = tuple(_floats(reference_at(flight, at_s).position_w_m) for at_s in times_s)
    _, rest = resting_place(reference_at(flight, time_s), cylinder.braking_mps2)
    return WayAhead(path, _floats(rest))


def in_reach(vehicle: VehicleState, others: Iterable[OtherVehicle], cylinder: Separation, ahead_s: float) -> bool:
    """Return True if another vehicle could be met within `ahead_s`."""
    place, speed_mps = _floats(vehicle.position_w_m), max(math.hypot(*vehicle.velocity_w_mps.tolist()), _SPEED_MPS)

    def near(other: OtherVehicle) -> bool:
        way_m = ahead_s * (speed_mps + math.hypot(*other.velocity_w_mps))
        return other.known and cylinder.gap_m(place, other) < way_m + _SPARE_M

    return any(near(other) for other in others)


def _floats(place: Array) -> Vec3:
    x, y, z = place.tolist()
    return x, y, z
