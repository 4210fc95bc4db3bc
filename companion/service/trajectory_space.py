"""Checks that a commanded motion stays in the room and inside the geofence."""

import asyncio

from companion.config.flight_config import LEAST_CLIMB_M, RoomConfig
from companion.config.safety_config import FenceConfig
from companion.core.interfaces import FlightError
from companion.core.types import Array
from companion.preflight.checks import start_place
from companion.preflight.checks.check import Check
from companion.trajectories.reference import Trajectory
from companion.trajectories.room_check import check_trajectory, instants_s

_NAME = "the trajectory"
_PIECE = 12
"""Instants of a trajectory that are checked at a time: 0.5 ms, during which no control cycle can start."""


def check_climb(height_m: float, position_w_m: Array | None, fence: FenceConfig) -> None:
    """Raise FlightError unless a hover `height_m` above this position keeps the geofence's margin.

    `position_w_m` (3,) is in W, None while it is not known.
    """
    if not height_m >= LEAST_CLIMB_M:
        raise FlightError(f"{height_m:g} m is too low to hover at, at least {LEAST_CLIMB_M:g} m")
    _require(start_place.check_standing(position_w_m, height_m, fence.fence(), fence.margin_m))


async def check_room_and_fence(trajectory: Trajectory, room: RoomConfig, fence: FenceConfig) -> None:
    """Check the trajectory like `require_inside`, in pieces, so that the control loop can run in between.

    Pieces overlap by two instants, which the acceleration of the heading is computed from.
    """
    times_s = instants_s(trajectory)
    for first in range(0, len(times_s), _PIECE):
        require_inside(trajectory, room, fence, _NAME, times_s[max(first - 2, 0) : first + _PIECE])
        await asyncio.sleep(0)


def require_inside(
    trajectory: Trajectory, room: RoomConfig, fence: FenceConfig, name: str, times_s: Array | None = None
) -> None:
    """Raise ConfigError with the first instant at which the trajectory leaves the room or is too fast.

    Raise FlightError where it, or braking from it, violates the geofence's margin. `name` is for the message; only
    `times_s` (n,) are checked, None for all of the trajectory.
    """
    check_trajectory(trajectory, room, name, times_s)
    _require(start_place.check_trajectory(trajectory, fence.fence(), fence.margin_m, times_s))


def _require(check: Check) -> None:
    if not check.passed:
        raise FlightError(f"{check.name}: {check.says}; {check.todo}")
