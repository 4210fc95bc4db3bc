"""One demo flight of several vehicles: mocks, broker and services as processes, and an operator over the broker."""

import asyncio
import math
import signal
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from companion.adapters.broker.process import open_broker
from companion.cli.demo.fleet.display import FleetDisplay
from companion.cli.demo.fleet.mission import Mission
from companion.cli.demo.fleet.room import RoomPlan
from companion.cli.demo.fleet.services import open_services
from companion.cli.demo.mock_process import COLLISION, FaultTold, MockError, mock_process
from companion.client.connecting import open_vehicles
from companion.client.messages import Message
from companion.client.vehicle import Vehicle
from companion.core.interfaces import CompanionError
from companion.protocol.telemetry import WAITING, Happened, State

_DEVICES_S = 60.0
"""Time for all services to find motion capture, autopilot and arms."""
_DOWN_S = 90.0
_LANDING = frozenset({"stow", "land"})


@dataclass(frozen=True, kw_only=True)
class FleetFlight:
    """Description of the flight."""

    plan: RoomPlan
    mock_config: Path
    seed: int
    faults: tuple[str, ...]
    laps: int
    arms: str | None
    """Motion during the laps; None without one."""
    records: Path
    """Folder of the records."""
    stay_s: float = 0.0
    """Time for which the services stay after the flight, s."""


@dataclass(kw_only=True)
class FleetFlown:
    """Result of the flight."""

    flew: bool = False
    interrupted: bool = False
    failure: str = ""
    """Reason why it did not go as planned; empty when it did."""
    collisions: list[str] = field(default_factory=list)
    records: dict[str, Path] = field(default_factory=dict)
    """Records by the vehicles' names."""
    landed: dict[str, bool] = field(default_factory=dict)
    """Whether each vehicle was disarmed on the ground at the end."""


async def fly_fleet(flight: FleetFlight, console: Console, end_page: Callable[[], None]) -> FleetFlown:
    """Start everything, fly, land, stop everything, whatever happens; CompanionError when it could not be started.

    `end_page` is called when all is over, before the broker that a page needs ends.
    """
    flown, display = FleetFlown(), FleetDisplay(console)
    ctrl_c = _CtrlC(flown, display)

    def hear(told: FaultTold) -> None:
        if told.turn == COLLISION:
            flown.collisions.append(told.sentence)
        display.tell_of_mocks(told)

    with display, tempfile.TemporaryDirectory(prefix="dauam-demo-") as folder:
        try:
            async with _vehicles(flight, Path(folder), display, hear) as vehicles:
                await _fly(flight, vehicles, display, ctrl_c)
                display.say("services, broker and mocks end")
                await asyncio.to_thread(end_page)
        except asyncio.CancelledError:
            if not flown.interrupted:
                raise
    return flown


class _CtrlC:
    """Reaction to Ctrl-C: the first one ends the flight, or the start; later ones do not disturb the landing."""

    def __init__(self, flown: FleetFlown, display: FleetDisplay) -> None:
        self.flown, self._display = flown, display
        self.work: asyncio.Task[None] | None = asyncio.current_task()
        """Task that the first one cancels; None once everything lands or ends anyway."""
        self.over = False
        """The flight is over, and the vehicles stay: ending that is no interrupt."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            asyncio.get_running_loop().add_signal_handler(number, self._press)

    def _press(self) -> None:
        self._display.say("interrupted: already ending" if self.work is None else "interrupted: all land")
        if self.work is not None:
            self.flown.interrupted = not self.over
            self.work.cancel()
            self.work = None


@asynccontextmanager
async def _vehicles(
    flight: FleetFlight, folder: Path, display: FleetDisplay, hear: Callable[[FaultTold], None]
) -> AsyncIterator[tuple[Vehicle, ...]]:
    """Start mocks, broker and services; yield the vehicles once their devices are connected."""
    plan = flight.plan
    async with AsyncExitStack() as stack:
        display.say(f"mocks of {len(plan.names)} vehicles; one broker: mqtt://{plan.broker.host}:{plan.broker.port}")
        await stack.enter_async_context(_mocks(flight, hear))
        await stack.enter_async_context(open_broker(plan.broker.model_copy(update={"embedded": True})))
        display.say(f"one service each: {', '.join(plan.names)}; the first goes first, a later one yields")
        services = await stack.enter_async_context(open_services(plan.write(folder), plan.broker))
        vehicles = await stack.enter_async_context(open_vehicles(plan.endpoints(), land=False))
        display.follow(vehicles)
        for vehicle, service in zip(vehicles, services, strict=True):
            await vehicle.wait_until(lambda state: state.phase != WAITING, timeout_s=_DEVICES_S)
            service.require_running()
        yield vehicles


@asynccontextmanager
async def _mocks(flight: FleetFlight, hear: Callable[[FaultTold], None]) -> AsyncIterator[None]:
    try:
        async with mock_process(flight.mock_config, flight.seed, flight.plan.ports, flight.faults, hear):
            yield
    except MockError as error:
        if "in use" in str(error):
            raise MockError(f"{error}; or fly with --free-ports") from error
        raise


async def _fly(flight: FleetFlight, vehicles: tuple[Vehicle, ...], display: FleetDisplay, ctrl_c: _CtrlC) -> None:
    """Fly the mission; land all after every error and interrupt."""
    flown = ctrl_c.flown
    with ExitStack() as stack:
        for vehicle in vehicles:
            stack.enter_context(vehicle.console.heard_by(_hearer(flight, vehicle.name, display, flown)))
        mission = Mission(flight.plan, vehicles, display.say, flight.arms)
        ctrl_c.work = work = asyncio.create_task(mission.fly(flight.laps), name="companion.demo")
        flown.failure = await _ending(work, flown)
        if flown.failure:
            display.say(f"{flown.failure}; all land")
        ctrl_c.work = None
        await asyncio.gather(*(_land(vehicle, flown) for vehicle in vehicles))
        if flight.stay_s and not flown.interrupted:
            await _stay(flight.stay_s, display, ctrl_c)
            await asyncio.gather(*(_land(vehicle, flown) for vehicle in vehicles))


async def _stay(for_s: float, display: FleetDisplay, ctrl_c: _CtrlC) -> None:
    """Leave the vehicles to the page for a time, or until Ctrl-C."""
    display.say("the vehicles stay on the page: fly on from there; Ctrl-C lands and ends")
    ctrl_c.over = True
    waiting = asyncio.Event().wait() if math.isinf(for_s) else asyncio.sleep(for_s)
    ctrl_c.work = asyncio.create_task(_ignore_result(waiting), name="companion.stay")
    await asyncio.gather(ctrl_c.work, return_exceptions=True)
    ctrl_c.work = None


async def _ignore_result(work: Awaitable[object]) -> None:
    await work


async def _ending(work: "asyncio.Task[None]", flown: FleetFlown) -> str:
    """Wait for the mission; return why it failed, empty when it did not, or Ctrl-C ended it."""
    try:
        await work
    except asyncio.CancelledError:
        if not flown.interrupted:
            raise
    except CompanionError as error:
        return str(error)
    except BaseExceptionGroup as several:
        other = several.split(CompanionError)[1]
        if other is not None:
            raise other from None
        return "; ".join(str(error) for error in several.exceptions)
    return ""


def _hearer(flight: FleetFlight, name: str, display: FleetDisplay, flown: FleetFlown) -> Callable[[Message], None]:
    def hear(message: Message) -> None:
        if isinstance(message, Happened):
            display.tell(name, message)
        elif isinstance(message, State) and message.record:
            flown.flew = flown.flew or bool(message.in_air)
            flown.records[name] = flight.records / message.record

    return hear


async def _land(vehicle: Vehicle, flown: FleetFlown) -> None:
    """Land a vehicle that is still armed, and note whether it is down."""
    try:
        state = await vehicle.console.find()
        if state.armed and state.phase not in _LANDING:
            await vehicle.abort(timeout_s=_DOWN_S)
        down = await vehicle.wait_until(lambda state: not state.armed, timeout_s=_DOWN_S)
        flown.landed[vehicle.name] = not down.in_air
    except CompanionError as error:
        flown.landed[vehicle.name] = False
        flown.failure = "; ".join(filter(None, (flown.failure, str(error))))
