"""Several flight loops in simulated time, in one room of the mock: in lockstep, the same seed gives the same flights.

Time passes when every loop that ticks waits for it. All loops see the frames of one QTM, each its own body and the
others; everything between a loop and its autopilot is as in tests/flights/simulated.py.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from companion.adapters.system.background import first_of
from companion.config.companion_config import CompanionConfig
from companion.config.separation_config import SeparationConfig
from companion.control.controller import Controller
from companion.core.types import MocapFrame
from companion.flight.assembly import Devices, stages_of
from companion.flight.flight_loop import FlightLoop
from companion.flight.tick import Tick
from mock_autopilot.config import MockConfig
from mock_autopilot.faults.mocap import FleetMocapFaults, MocapFaults
from mock_autopilot.fleet.config import fleet_cameras
from mock_autopilot.fleet.fleet import Fleet
from mock_autopilot.mavlink.streams import TICK_S
from mock_autopilot.physics.truth import Truth
from mock_autopilot.qtm.camera import Camera
from mock_autopilot.world import STEP_S
from tests.flights.simulated import BRISK, HEAVY, PX4_PARAMS, Flight, Script, Step, VehicleInRoom, law_of
from tests.flights.simulated_autopilot import SimulatedAutopilot
from tests.flights.simulated_qtm import SimulatedQtm
from tests.mock_autopilot.bench import Bench
from tests.watchdog_timer import NoWatchdogTimer

Watch = Callable[[Flight, Tick], None]
"""Called with every tick of a vehicle."""


class FleetRoom:
    """Vehicles, cameras and time; `tables` are the mock's."""

    def __init__(
        self, vehicles: int, seed: int, tables: Mapping[str, Any] | None = None, step_s: float = STEP_S
    ) -> None:
        given = {"px4": {"params": PX4_PARAMS}, "plant": HEAVY, **(tables or {})}
        fleet = {"vehicles": vehicles, **given.pop("fleet", {})}
        config = MockConfig.from_dict({**given, "fleet": fleet})
        self.fleet = Fleet(config, seed, step_s)
        self.vehicles = [VehicleInRoom(Bench.of(world)) for world in self.fleet.worlds]
        cameras = fleet_cameras(config)
        self._camera = Camera(cameras, seed)
        self._faults = FleetMocapFaults(
            [
                MocapFaults(world.faults, world.fault_rng(), cameras.rate_hz, place, alone=True)
                for place, world in enumerate(self.fleet.worlds)
            ]
        )
        names = self.fleet.names
        self._qtms = [
            SimulatedQtm(cameras, self._faults, vehicle, name, [other for other in names if other != name])
            for vehicle, name in zip(self.vehicles, names, strict=True)
        ]
        self._ticks = 0
        self.fleet.observers.append(self._look)

    def now_s(self) -> float:
        """Return the simulated time."""
        return self.fleet.time_s

    def tick(self) -> None:
        """Let one tick of the mock pass, 4 ms."""
        for vehicle in self.vehicles:
            vehicle.bench.before_tick()
        self._ticks += 1
        self.fleet.advance(self._ticks * TICK_S)
        for vehicle in self.vehicles:
            vehicle.bench.after_tick()

    def _look(self, truths: tuple[Truth, ...]) -> None:
        for frame in self._faults.pass_on(self._camera.look(truths[0], truths[1:]), truths[0].time_s):
            if self._faults.breaks_packets:
                continue
            for vehicle, qtm in zip(self.vehicles, self._qtms, strict=True):
                seen = qtm.frame(frame)
                if seen is not None:
                    vehicle.take(seen)


@dataclass
class _Waiting:
    until_s: float
    woken: "asyncio.Future[bool]"


class Lockstep:
    """Time of the room, which passes when all vehicles that tick wait for it."""

    def __init__(self, room: FleetRoom) -> None:
        self._room = room
        self._waiting: dict[int, _Waiting] = {}
        self._loops: list[FlightLoop] = []
        self._frozen: set[int] = set()

    def add(self, loop: FlightLoop) -> None:
        """Add the loop of the next vehicle."""
        self._loops.append(loop)

    def freeze(self, number: int) -> None:
        """Let a vehicle's loop (0 is the first) and its MAVSDK do nothing more."""
        self._frozen.add(number)
        self._room.vehicles[number].bench.client_ended = True

    async def wait(self, number: int, for_s: float) -> bool:
        """Wait for the vehicle's next frame; False when none came in time."""
        woken: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._waiting[number] = _Waiting(self._room.now_s() + for_s, woken)
        return await woken

    async def drive(self) -> None:
        """Let time pass for ever."""
        while True:
            if all(self._rests(number) for number in range(len(self._loops))):
                self._room.tick()
                while not self._wake() and self._waiting:
                    self._room.tick()
            await asyncio.sleep(0)

    def _rests(self, number: int) -> bool:
        return number in self._frozen or number in self._waiting or not self._loops[number].ticking

    def _wake(self) -> bool:
        """Wake the vehicles for which a frame has come or the time is over; return True if there were any."""
        now_s, due = self._room.now_s(), []
        for number, waiting in self._waiting.items():
            if number not in self._frozen and (self._room.vehicles[number].new_frame or now_s >= waiting.until_s):
                due.append(number)
        for number in due:
            vehicle, waiting = self._room.vehicles[number], self._waiting.pop(number)
            fresh, vehicle.new_frame = vehicle.new_frame, False
            if not waiting.woken.done():
                waiting.woken.set_result(fresh)
        return bool(due) or self._frozen >= self._waiting.keys()


class FleetMocap:
    """interfaces.MocapSource of one vehicle."""

    def __init__(self, lockstep: Lockstep, number: int, vehicle: VehicleInRoom, every_tick: Callable[[], None]) -> None:
        self._lockstep, self._number, self._vehicle, self._every_tick = lockstep, number, vehicle, every_tick

    def latest(self) -> MocapFrame | None:
        return self._vehicle.frame

    def why_silent(self) -> str:
        return ""

    async def wait_frame(self, timeout_s: float) -> bool:
        self._every_tick()
        return await self._lockstep.wait(self._number, timeout_s)


@dataclass(repr=False)
class FleetFlight:
    """The flights of all vehicles of a room."""

    room: FleetRoom
    lockstep: Lockstep
    flights: list[Flight]
    scripts: list[Script]

    def freeze(self, number: int) -> None:
        """Stop a vehicle's service (0 is the first): it does nothing more, and its script is over."""
        self.lockstep.freeze(number)
        self.scripts[number].end()


def fleet_config(
    names: Sequence[str], number: int, base: CompanionConfig | None = None, separated: bool = True
) -> CompanionConfig:
    """Return the configuration of vehicle `number` (0 is the first), which keeps its distance from all the others."""
    base = base or CompanionConfig(flight=BRISK)
    mocap = base.mocap.model_copy(update={"body": names[number]})
    separation = SeparationConfig.model_validate(
        {**base.separation.model_dump(), "order": tuple(names) if separated else ()}
    )
    return CompanionConfig.model_validate({**dict(base), "mocap": mocap, "separation": separation})


async def fly_fleet(
    scripts: Sequence[Sequence[Step]],
    *,
    controller: str | Controller = "practical",
    config: CompanionConfig | None = None,
    seed: int = 1,
    tables: Mapping[str, Any] | None = None,
    step_s: float = STEP_S,
    separated: bool = True,
    watch: Watch | None = None,
    made: Callable[[FleetFlight], None] | None = None,
    longest_s: float = 120.0,
) -> FleetFlight:
    """Run one loop for each script until all scripts have ended; raises what a script or a loop raises.

    `config` is that of all vehicles but for their bodies; unless `separated` they do not look out for each other. With
    `watch` the ticks go there and are not kept. `made` gets the flights before they begin.
    """
    room = FleetRoom(len(scripts), seed, tables, step_s)
    lockstep = Lockstep(room)
    told = [Script(steps, longest_s) for steps in scripts]
    fleet = FleetFlight(room, lockstep, [], told)
    for number, script in enumerate(told):
        one = fleet_config(room.fleet.names, number, config, separated)
        flight = _assembled(fleet, number, one, law_of(controller, one), script, watch)
        fleet.flights.append(flight)
        lockstep.add(flight.loop)
    if made is not None:
        made(fleet)
    running = [asyncio.create_task(flight.loop.run(), name="flight") for flight in fleet.flights]
    clock = asyncio.create_task(lockstep.drive(), name="clock")
    scripted = asyncio.gather(*(script.ended for script in told))
    await first_of(*running, scripted, clock)
    return fleet


def _assembled(
    fleet: FleetFlight, number: int, config: CompanionConfig, law: Controller, script: Script, watch: Watch | None
) -> Flight:
    """Return one vehicle's flight, ready to run."""
    vehicle = fleet.room.vehicles[number]
    cameras = FleetMocap(fleet.lockstep, number, vehicle, lambda: script.every_tick(flight))
    autopilot = SimulatedAutopilot(vehicle.bench)
    devices = Devices(mocap=cameras, autopilot=autopilot, clock=vehicle, watchdog_timer=NoWatchdogTimer())

    def sink(tick: Tick) -> None:
        if watch is not None:
            watch(flight, tick)
            return
        flight.ticks.append(tick)
        flight.truths_w_m.append(vehicle.truth_w_m)

    flight = Flight(vehicle, autopilot, FlightLoop(devices, stages_of(devices, law, config), sink), None)
    return flight
