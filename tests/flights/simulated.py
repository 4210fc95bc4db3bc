"""The flight loop in simulated time: the mock's world and cameras behind the ports, no sockets, no sleeping.

`FlightLoop.run` waits for a frame; here that wait is what lets simulated time pass. So the very loop that flies runs as
fast as the machine can, and the same seed gives the same flight.
"""

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from companion.adapters.mocap.newest_frame import RESTART_S
from companion.adapters.system.background import first_of
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import load_controller
from companion.config.flight_config import FlightConfig
from companion.control.controller import Controller
from companion.core.interfaces import MocapError
from companion.core.types import Array, MocapFrame
from companion.flight.assembly import Devices, stages_of
from companion.flight.estimate_step import LinkPoses
from companion.flight.flight_loop import FlightLoop
from companion.flight.tick import Tick
from companion.geometry.frames import flip_yz
from companion.supervisor.flight_state import Phase
from mock_autopilot.config import MockConfig
from mock_autopilot.faults.mocap import MocapFaults
from mock_autopilot.faults.schedule import FaultSchedule, FaultTransition
from mock_autopilot.faults.sentences import parse
from mock_autopilot.mavlink.streams import TICK_S
from mock_autopilot.physics.truth import Truth
from mock_autopilot.qtm.camera import Camera
from mock_autopilot.qtm.config import QualisysConfig
from tests.flights.command import ROOT
from tests.flights.simulated_autopilot import SimulatedAutopilot
from tests.flights.simulated_bus import simulated_bus
from tests.flights.simulated_ground import GroundSetup, GroundWorld
from tests.flights.simulated_qtm import SimulatedQtm
from tests.flights.simulated_servos import SimulatedServos
from tests.mock_autopilot.bench import IMPERFECT, Bench
from tests.watchdog_timer import NoWatchdogTimer

PX4_PARAMS = MockConfig.load(ROOT / "config" / "mock.toml").px4.params
"""The demo's: what a vehicle in that room has set."""
BRISK = FlightConfig(climb_speed_mps=1.0, descent_speed_mps=0.4, spool_up_s=0.5)
"""So many flights are to be short."""
HEAVY: dict[str, Any] = {"mass_kg": 4.85, "max_thrust_n": 95.1}
"""The paper's vehicle."""


class VehicleInRoom:
    """One vehicle in a room, and the frames that reach its companion."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        bench.setpoint_period_s = 0.05  # MAVSDK re-sends the last setpoint at 20 Hz by itself
        self.fault_turns: list[FaultTransition] = []
        """Every fault that began or ended, and when."""
        bench.world.faults.observers.append(self.fault_turns.append)
        self.frame: MocapFrame | None = None
        self.new_frame = False
        self.late = 0
        """Frames that never came here because a newer one had."""
        self.offset_w_m = np.zeros(3)
        """Error of motion capture from now on."""

    def now_s(self) -> float:
        """interfaces.Clock: simulated time."""
        return self.bench.now_s

    def inject(self, sentence: str) -> None:
        """Let something go wrong, from now on or when its time comes: "mocap stuck for 2 s" (docs/faults.md)."""
        self.bench.world.inject(parse(sentence))

    @property
    def faults(self) -> FaultSchedule:
        """Faults that are injected."""
        return self.bench.world.faults

    @property
    def truth_w_m(self) -> Array:
        """Return the true place of the vehicle, W, m."""
        return flip_yz(self.bench.world.truth.position_ned_m)

    def take(self, seen: MocapFrame) -> None:
        """Let a frame arrive."""
        if self._is_overtaken(seen):
            self.late += 1
            return
        self.frame = replace(seen, position_w_m=seen.position_w_m + self.offset_w_m, late=self.late)
        self.new_frame = True

    def _is_overtaken(self, seen: MocapFrame) -> bool:
        """Older than the newest, but not by so much that it is another measurement: as the real adapter has it."""
        if self.frame is None:
            return False
        return self.frame.stamp_s - RESTART_S <= seen.stamp_s <= self.frame.stamp_s


class Room(VehicleInRoom):
    """Vehicle, cameras and time; `estimator` is the mock's [estimator]."""

    def __init__(
        self,
        seed: int,
        plant: dict[str, Any] | None = None,
        mocap: dict[str, Any] | None = None,
        start: dict[str, Any] | None = None,
        arms: dict[str, Any] | None = None,
        faults: Sequence[str] = (),
        estimator: Mapping[str, Any] = IMPERFECT,
        *,
        step_s: float = TICK_S,
    ) -> None:
        bench = Bench(
            PX4_PARAMS,
            HEAVY | (plant or {}),
            seed=seed,
            vehicle=start,
            arms=arms,
            faults=faults,
            estimator=estimator,
            step_s=step_s,
        )
        super().__init__(bench)
        cameras, world = QualisysConfig.model_validate(mocap or {}), self.bench.world
        self._camera = Camera(cameras, seed)
        self._faults = MocapFaults(world.faults, world.fault_rng(), cameras.rate_hz)
        self._qtm = SimulatedQtm(cameras, self._faults, self)
        self.bench.world.observers.append(self._look)

    def pass_time(self, for_s: float) -> None:
        """Advance to the next frame, or by `for_s` and at least one step."""
        end_s = self.now_s() + for_s
        while not self.new_frame:
            self.bench.run(TICK_S)
            if self.now_s() >= end_s:
                return

    def _look(self, truth: Truth) -> None:
        for frame in self._faults.pass_on(self._camera.look(truth), truth.time_s):
            if self._faults.breaks_packets:
                continue  # the client cannot make anything of it
            seen = self._qtm.frame(frame)
            if seen is not None:  # else QTM's list of bodies may have changed
                self.take(seen)


class SimulatedMocap:
    """interfaces.MocapSource."""

    def __init__(self, room: Room, every_tick: Callable[[], None], frames: bool = True) -> None:
        """Without `frames`, only a law on the ground gets them."""
        self._room, self._every_tick, self._frames = room, every_tick, frames
        self._last: MocapFrame | None = None
        self.lost_at_s = math.inf
        """Then the connection breaks, which ends the flight loop."""

    def latest(self) -> MocapFrame | None:
        if not self._frames:
            return None
        if self._room.now_s() <= self.lost_at_s:
            self._last = self._room.frame
        return self._last

    def why_silent(self) -> str:
        return ""

    async def wait_frame(self, timeout_s: float) -> bool:
        await asyncio.sleep(0)
        if self._room.now_s() > self.lost_at_s:
            raise MocapError("the connection to QTM was lost")
        self._every_tick()
        return self._passed(timeout_s) if self._frames else self._passed_without_frames(timeout_s)

    def _passed(self, for_s: float) -> bool:
        self._room.pass_time(for_s)
        fresh, self._room.new_frame = self._room.new_frame, False
        return fresh

    def _passed_without_frames(self, for_s: float) -> bool:
        end_s = self._room.now_s() + for_s
        while self._room.now_s() < end_s:
            self._passed(end_s - self._room.now_s())
        return False


class FlightTimeoutError(AssertionError):
    """The script did not end in time."""


async def _time_goes_on(room: Room, loop: FlightLoop, longest_s: float) -> None:
    """Once the loop has failed nobody waits for frames any more, and time passes by itself; FlightTimeoutError."""
    while loop.ticking or room.now_s() <= longest_s:  # while it ticks, the script's own end says what was left
        await asyncio.sleep(0.005)
        if not loop.ticking:
            room.bench.run(0.02)
    raise FlightTimeoutError(f"the loop has failed and is not done with it, phase {loop.flight.phase}")


Step = Callable[["Flight"], bool]
"""Called every cycle; True when it is done and the next one begins."""


@dataclass(repr=False, eq=False)  # thousands of ticks
class Flight:
    """A flight in progress, for the script that commands it and the checks afterwards."""

    room: VehicleInRoom
    autopilot: SimulatedAutopilot
    loop: FlightLoop
    servos: SimulatedServos | None
    """None for a vehicle without arms, and where they have their real driver."""
    ground: GroundWorld | None = None
    """None for a law on board."""
    ticks: list[Tick] = field(default_factory=list)
    truths_w_m: list[Array] = field(default_factory=list)
    """True position of the vehicle at each tick."""

    @property
    def phase(self) -> Phase:
        return self.loop.flight.phase

    def phases(self) -> list[Phase]:
        """Every phase in the order it was reached."""
        seen: list[Phase] = []
        for tick in self.ticks:
            if not seen or tick.flight.phase is not seen[-1]:
                seen.append(tick.flight.phase)
        return seen


class Script:
    """The steps of one vehicle's script, one after the other; `ended` is done with the last, or has what one raised."""

    def __init__(self, steps: Sequence[Step], longest_s: float) -> None:
        self._steps, self._longest_s = list(steps), longest_s
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def end(self) -> None:
        """End it as if it were done."""
        if not self.ended.done():
            self.ended.set_result(None)

    def every_tick(self, flight: Flight) -> None:
        """Go on in the script; FlightTimeoutError in `ended` when it takes too long."""
        if self.ended.done():
            return
        steps = self._steps
        try:
            if steps and steps[0](flight):
                steps.pop(0)
        except Exception as error:
            self.ended.set_exception(error)
            return
        if not steps:
            self.ended.set_result(None)
        elif flight.room.now_s() > self._longest_s:
            late = f"{len(steps)} steps of the script are left, phase {flight.phase}"
            self.ended.set_exception(FlightTimeoutError(late))


def law_of(controller: str | Controller, config: CompanionConfig) -> Controller:
    """Return a law, loaded if it is named."""
    return load_controller(controller, config.vehicle_model(), 0.01).law if isinstance(controller, str) else controller


async def fly(
    script: list[Step],
    *,
    controller: str | Controller = "etnn",
    config: CompanionConfig | None = None,
    seed: int = 1,
    plant: dict[str, Any] | None = None,
    mocap: dict[str, Any] | None = None,
    start: dict[str, Any] | None = None,
    arms: dict[str, Any] | None = None,
    lost_land_commands: int = 0,
    raise_in_sink_at_s: float = math.inf,
    mocap_lost_at_s: float = math.inf,
    faults: Sequence[str] = (),
    estimator: Mapping[str, Any] = IMPERFECT,
    real_driver: bool = False,
    ground: GroundSetup | None = None,
    longest_s: float = 120.0,
    step_s: float = TICK_S,
) -> Flight:
    """Run the loop until the script has ended, BRISK unless `config` says otherwise; raises what the loop raises.

    What the script raises, and FlightTimeoutError, end the flight at once: they are the test's, not the loop's.
    `estimator` is the mock's [estimator]: its horizon errs as PX4's does unless it is PERFECT.
    With `ground` the law runs there, and frames reach the vehicle, too, if `config.law.onboard_mocap` says so.
    The physics' step is twice the mock's own, a third less to compute, and all that its streams and cameras resolve.
    With `real_driver` the arms' own driver speaks to the mock's servos, which takes longer and notices what ails them.
    """
    config = config or CompanionConfig(flight=BRISK, arms=ArmsConfig() if arms is not None else None)
    law = law_of(controller, config)
    room = Room(seed, plant, mocap, start, arms, faults, estimator, step_s=step_s)
    told = Script(script, longest_s)

    def sink(tick: Tick) -> None:
        flight.ticks.append(tick)
        flight.truths_w_m.append(room.truth_w_m)
        if room.now_s() > raise_in_sink_at_s:
            raise BrokenPipeError("nobody reads this any more")

    autopilot = SimulatedAutopilot(room.bench)
    autopilot.deaf_to_land = lost_land_commands
    servos = SimulatedServos(room) if arms is not None and not real_driver else None
    bus = simulated_bus(config.arms, room) if config.arms is not None and real_driver else servos
    cameras = SimulatedMocap(room, lambda: told.every_tick(flight), config.law.onboard_mocap)
    cameras.lost_at_s = mocap_lost_at_s
    split = GroundWorld(room, ground, config, controller, seed) if ground is not None else None
    if split is not None:
        room.bench.world.observers.append(lambda _: split.step())
    devices = Devices(
        mocap=cameras,
        autopilot=autopilot,
        clock=room,
        watchdog_timer=NoWatchdogTimer(),
        arms=bus,
        law_link=None if split is None else split.vehicle,
        ground_poses=None if split is None or config.law.onboard_mocap else LinkPoses(split.end),
    )
    loop = FlightLoop(devices, stages_of(devices, law, config), sink)
    flight = Flight(room, autopilot, loop, servos, split)
    running = asyncio.create_task(loop.run(), name="flight")
    clock = asyncio.create_task(_time_goes_on(room, loop, longest_s), name="clock")
    await first_of(running, told.ended, clock)
    return flight
