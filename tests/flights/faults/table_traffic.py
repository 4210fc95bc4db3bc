"""Flights in which another vehicle, which goes first, comes near or is lost by motion capture.

The other one is a body in the frames alone: it obeys no rule, and nothing happens if they meet.
"""

import math
from collections.abc import Callable
from dataclasses import replace

from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import RoomConfig
from companion.config.safety_config import FenceConfig
from companion.config.separation_config import SeparationConfig
from companion.core.types import MocapFrame, OtherBody, Vec3
from companion.supervisor.faults import Fault
from companion.supervisor.flight_state import TakeoffRequest
from companion.supervisor.state_machine import reference_at
from tests.flights.faults.rows import CONFIG, RULES, Act, Conditions, End, Row, When, within
from tests.flights.simulated import Flight

OURS, NOT = End.LANDED, End.NOT_STARTED
OTHER = "other"
SHARED = Conditions(
    CompanionConfig.model_validate(
        {**dict(CONFIG), "separation": SeparationConfig(order=(OTHER, CONFIG.mocap.body))}
    )
)  # fmt: skip
"""A room of two vehicles, in which the other one goes first."""
FENCE_M = 1.5
NARROW = Conditions(
    SHARED.config.model_copy(
        update={"fence": FenceConfig(x_m=(-FENCE_M, FENCE_M)), "room": RoomConfig(x_m=(-1.2, 1.2))}
    )
)  # fmt: skip
AHEAD_S = 3.0
SEEN_S = 1.0
COMES_S = 4.0
"""Way to the vehicle, at 0.4 m/s."""

Path = Callable[[float], Vec3 | None]
"""Position of the other body (m, W) so long (s) after the fault's begin; None while it is not seen."""


def another(path_of: Callable[[Flight], Path]) -> Act:
    """Another body, from now on in every frame."""

    def begin(flight: Flight) -> None:
        room, path = flight.room, path_of(flight)
        take, begin_s = room.take, room.now_s()

        def take_both(seen: MocapFrame) -> None:
            take(replace(seen, others=(OtherBody(OTHER, path(room.now_s() - begin_s)),)))

        room.take = take_both  # type: ignore[method-assign]

    return begin


def hovers_ahead(flight: Flight) -> Path:
    """Return a path that stays where the reference will be soon."""
    x, y, z = reference_at(flight.loop.flight, flight.room.now_s() + AHEAD_S).position_w_m.tolist()
    return lambda _: (x, y, z)


def comes(from_m: float, to_m: float, in_s: float = COMES_S) -> Callable[[Flight], Path]:
    """Return a path along y at the vehicle's height, to a distance from where it is now, in so long."""

    def path_of(flight: Flight) -> Path:
        x, y, z = flight.room.truth_w_m.tolist()
        return lambda t: (x, y + from_m + (to_m - from_m) * min(t / in_s, 1.0), z)

    return path_of


def drives_to_the_fence(flight: Flight) -> Path:
    """Return a path along x through where the vehicle is, to 0.3 m from the narrow fence, at 0.8 m/s."""
    x, y, z = flight.room.truth_w_m.tolist()
    return lambda t: (min(x - 4.0 + 0.8 * t, FENCE_M - 0.3), y, z)


def take_off(flight: Flight) -> None:
    """Order a takeoff, as the operator does."""
    assert not flight.loop.submit(TakeoffRequest(1.2))


def flies_over(flight: Flight) -> Path:
    """Return a path over the vehicle, higher than one needs to fly over a parked one, at 1 m/s."""
    x, y, z = flight.room.truth_w_m.tolist()
    return lambda t: (x - 4.0 + t, y, z + 1.4)


def lost_after(seen_s: float, for_s: float = math.inf) -> Callable[[Flight], Path]:
    """Return a path in a far corner, seen for so long, then not."""
    return lambda _: lambda t: None if seen_s <= t < seen_s + for_s else (3.5, 3.5, 0.1)


TRAFFIC = (
    Row(Fault.TRAFFIC, "another one hovers where the way leads", (another(hovers_ahead),), OURS, within(AHEAD_S),
        When.TRACK, flown_with=SHARED),
    Row(Fault.TRAFFIC_BLOCKED, "another one stops 1.4 m away", (another(comes(3.0, 1.4)),), OURS,
        within(COMES_S + RULES.yield_s), When.HOVER, patience_s=10.0, flown_with=SHARED),
    Row(Fault.SEPARATION_LOST, "another one appears 1 m away", (another(comes(1.0, 1.0)),), OURS,
        within(0.1), When.HOVER, flown_with=SHARED),
    Row(Fault.SEPARATION_LOST, "another one drives it to the fence", (another(drives_to_the_fence),), OURS, within(6.5),
        When.HOVER, patience_s=12.0, flown_with=NARROW),
    Row(Fault.SEPARATION_LOST, "another one is carried to it", (another(comes(3.0, 1.0)),), NOT, within(COMES_S),
        When.GROUND, flown_with=SHARED),
    Row(Fault.SEPARATION_LOST, "another one flies over its takeoff", (take_off, another(flies_over)), NOT, within(0.4),
        When.GROUND, flown_with=SHARED),
    Row(Fault.OTHER_UNSEEN, "the other one's markers are covered", (another(lost_after(SEEN_S)),), OURS,
        within(SEEN_S + RULES.other_unseen_s), When.TRACK, flown_with=SHARED),
    Row(Fault.OTHER_UNSEEN, "covered for 0.4 s", (another(lost_after(SEEN_S, 0.4)),), End.FLIES_ON, 0.0, When.TRACK,
        harmless=True, flown_with=SHARED),
)  # fmt: skip
