"""Other vehicles of the room: does motion capture know them, and do they stand far enough away? Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.core.types import Array, OtherBody, OtherVehicle
from companion.guard.separation import Separation
from companion.preflight.checks.check import Check

_LATELY_S = 0.5
"""Time since it was seen within which a vehicle counts as seen."""
_NAME = "other bodies"


@dataclass(frozen=True)
class OtherVehicleFacts:
    """Facts about the other vehicles: their bodies in the newest frame, and their motion."""

    bodies: tuple[OtherBody, ...] = ()
    vehicles: tuple[OtherVehicle, ...] = ()


def check_other_vehicles(
    seen: OtherVehicleFacts, names: Sequence[str], position_w_m: Array | None, clear: Separation
) -> tuple[Check, ...]:
    """Check every other vehicle of [separation]; `clear` is the cylinder with its margin.

    One that QTM does not define prevents arming. One that is defined and not seen is a warning: it may be elsewhere.
    """
    undefined = [body for body in seen.bodies if body.why_unseen]
    if undefined or not seen.bodies:
        why = undefined[0].why_unseen if undefined else "no frame has come"
        todo = "define it in QTM, or take it out of separation.order in the file of every vehicle"
        return (Check(f"{_NAME} defined", False, why, todo),)
    known = {vehicle.body: vehicle for vehicle in seen.vehicles if vehicle.unseen_s <= _LATELY_S}
    defined = Check(f"{_NAME} defined", True, ", ".join(names))
    return defined, *_unseen([name for name in names if name not in known]), _distance(known, position_w_m, clear)


def _unseen(names: Sequence[str]) -> tuple[Check, ...]:
    if not names:
        return ()
    todo = "see that it is not in the room, or uncover its markers"
    return (Check(f"{_NAME} seen", False, f"not seen: {', '.join(names)}", todo, must=False),)


def _distance(known: dict[str, OtherVehicle], position_w_m: Array | None, clear: Separation) -> Check:
    name = "distance to other vehicles"
    if position_w_m is None:
        return Check(name, False, "where the vehicle stands is not known", "see the mocap checks")
    if not known:
        return Check(name, True, "none is seen")
    x, y, _ = position_w_m.tolist()
    near_m, body = min(
        (math.hypot(one.position_w_m[0] - x, one.position_w_m[1] - y), one.body) for one in known.values()
    )
    says = f"{near_m:.2f} m to {body!r}, at least {clear.radius_m:.2f} m wanted"
    return Check(name, near_m >= clear.radius_m, says, "carry one of the two further away")


def check_seen_as_parked(position_w_m: Array | None, below_m: float) -> Check:
    """Check that the others take this vehicle, which stands, for parked; otherwise they yield to it as if it flew."""
    name, todo = "seen as parked", "raise separation.parked_below_m in the file of every vehicle"
    if position_w_m is None:
        return Check(name, False, "where the vehicle stands is not known", "see the mocap checks")
    height_m = float(position_w_m[2])
    return Check(
        name, height_m < below_m, f"stands at a height of {height_m:.2f} m, below {below_m:.2f} m wanted", todo
    )
