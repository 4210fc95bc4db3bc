"""Flight plan of a demo's vehicles: laps side by side, crossing ways of which the later one yields, landing."""

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np

from companion.cli.demo.fleet.room import LANE_M, RoomPlan
from companion.client.command_draft import CommandDraft
from companion.client.connecting import together
from companion.client.errors import FailedError, RejectedError
from companion.client.messages import Message
from companion.client.vehicle import Vehicle
from companion.core.interfaces import CompanionError, FlightError
from companion.core.types import Array
from companion.protocol.telemetry import Answer, Reply
from companion.trajectories.reference import Ellipse, LapTiming

_SEMI_AXES_M = (0.8, 0.4)
_PERIOD_S = 10.0
_RAMP_S = 4.0
_SAMPLE_S = 0.2
_CORNER_X_M = 1.8
_AGAIN_S = 1.0
_PATIENCE_S = 40.0
"""Longest wait for the other vehicle to leave the way."""
_MIDDLE_M = 0.3
_SETTLED_S = 1.0

Say = Callable[[str], None]


class Mission:
    """One flight of all vehicles, from arming to landing."""

    def __init__(self, plan: RoomPlan, vehicles: tuple[Vehicle, ...], say: Say, arms: str | None) -> None:
        """`say` prints a step; `arms` is the motion during the laps, None without one."""
        self._plan, self._vehicles, self._say, self._arms = plan, vehicles, say, arms
        self._height_m = plan.configs[0].flight.takeoff_height_m

    async def fly(self, laps: int) -> None:
        """Fly all of it; raises the first command's error that the plan does not expect."""
        self._say(f"all arm, then take off together to {self._height_m:g} m")
        await together(*(_named(vehicle, vehicle.arm()) for vehicle in self._vehicles))
        await together(*(_named(vehicle, vehicle.takeoff()) for vehicle in self._vehicles))
        await asyncio.sleep(_SETTLED_S)
        self._say(f"each to its own lane, {LANE_M:g} m apart")
        lanes_y_m = [self._plan.lane_y_m(index) for index in range(len(self._vehicles))]
        starts = zip(self._vehicles, lanes_y_m, strict=True)
        await together(*(_named(vehicle, self._insist(vehicle, _SEMI_AXES_M[0], y_m)) for vehicle, y_m in starts))
        self._say(f"{laps} laps side by side at the same time")
        await together(*(self._laps(index, vehicle, laps) for index, vehicle in enumerate(self._vehicles)))
        await self._cross(*self._vehicles[:2])
        self._say("all land together")
        await together(*(_named(vehicle, vehicle.land()) for vehicle in self._vehicles))

    async def _laps(self, index: int, vehicle: Vehicle, laps: int) -> None:
        """Fly laps around the vehicle's own lane."""
        path = lap_waypoints(self._plan.lane_y_m(index), self._height_m, laps)
        await _named(vehicle, vehicle.track(path, arms=self._arms))

    async def _cross(self, first: Vehicle, second: Vehicle) -> None:
        """Fly along both diagonals of a rectangle: the first goes ahead and stops in the middle, the second yields."""
        y_m = (self._plan.lane_y_m(0), self._plan.lane_y_m(1))
        self._say(f"to two corners, from which the ways of {first.name} and {second.name} cross")
        corners = zip((first, second), y_m, strict=True)
        await together(*(_named(one, self._insist(one, _CORNER_X_M, y)) for one, y in corners))
        self._say(f"{first.name} goes first")
        leading = asyncio.create_task(self._lead(first, y_m[1]), name="companion.demo_leading")
        try:
            await first.wait_until(lambda state: state.doing is not None, timeout_s=_PATIENCE_S)
            await asyncio.sleep(_AGAIN_S)
            await _named(second, self._insist(second, -_CORNER_X_M, y_m[0]))
            await leading
        finally:
            leading.cancel()
            await asyncio.gather(leading, return_exceptions=True)

    async def _lead(self, first: Vehicle, y_m: float) -> None:
        """Fly to the far corner, with a stop in the middle that nobody has announced."""
        middle_y_m = 0.5 * (self._plan.lane_y_m(0) + self._plan.lane_y_m(1))
        going = asyncio.create_task(self._go(first, -_CORNER_X_M, y_m), name="companion.demo_going")
        try:
            await first.wait_until(
                lambda state: state.position_w_m is not None and abs(state.position_w_m[1] - middle_y_m) < _MIDDLE_M,
                timeout_s=_PATIENCE_S,
            )
            self._say(f"an operator holds {first.name} in the middle of the crossing")
            await first.hold()
        finally:
            await asyncio.gather(going, return_exceptions=True)
        await asyncio.sleep(_SETTLED_S)
        self._say(f"{first.name} flies on")
        await _named(first, self._insist(first, -_CORNER_X_M, y_m))

    async def _insist(self, vehicle: Vehicle, x_m: float, y_m: float) -> None:
        """Fly to a place; try again while the other vehicle is in the way. FlightError when it stays there."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + _PATIENCE_S
        while True:
            try:
                return await self._go(vehicle, x_m, y_m)
            except (RejectedError, FailedError) as error:
                if loop.time() > end_s or vehicle.state.phase != "hold":
                    raise
                why = error
            if loop.time() > end_s:
                raise FlightError(f"{vehicle.name} has waited {_PATIENCE_S:g} s for its way: {why}")
            await asyncio.sleep(_AGAIN_S)

    async def _go(self, vehicle: Vehicle, x_m: float, y_m: float) -> None:
        """Fly to a place at the height of all."""

        def hear(message: Message) -> None:
            if isinstance(message, Reply) and message.answer is Answer.ACCEPTED and message.text:
                self._say(f"{vehicle.name}: {message.text}")

        await vehicle.execute(CommandDraft("goto", x_m=x_m, y_m=y_m, z_m=self._height_m), hear=hear)


async def _named(vehicle: Vehicle, work: Awaitable[object]) -> None:
    """Wait for a command; its error says which vehicle's it is."""
    try:
        await work
    except CompanionError as error:
        raise FlightError(f"{vehicle.name}: {error}") from error


def lap_waypoints(lane_y_m: float, height_m: float, laps: int) -> Array:
    """Return waypoints (n, 4) of t_s, x_m, y_m, z_m around (0, lane_y_m), at rest at both ends."""
    timing = LapTiming(_PERIOD_S, laps, _RAMP_S)
    curve = Ellipse(np.array([0.0, lane_y_m, height_m]), _SEMI_AXES_M, timing)
    times_s = np.linspace(0.0, timing.duration_s, round(timing.duration_s / _SAMPLE_S) + 1)
    places = np.array([curve.at(time_s).position_w_m for time_s in times_s.tolist()])
    return np.column_stack([times_s, places])
