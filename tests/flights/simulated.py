"""The flight loop in simulated time: the mock's world and cameras behind the ports, no sockets, no sleeping.

`FlightLoop.run` waits for a frame; here that wait is what lets simulated time pass. So the very loop that flies runs as
fast as the machine can, and the same seed gives the same flight.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from companion.config import CompanionConfig
from companion.config_arms import ArmsConfig
from companion.config_controller import load_controller
from companion.control.controller import Controller
from companion.control.frames import flip_quat, flip_yz
from companion.flight_loop import Devices, FlightLoop
from companion.ports import AutopilotError, MocapError
from companion.supervisor.flight import Phase
from companion.tick import Tick
from companion.types import Array, AttitudeThrust, AutopilotStatus, FlightMode, MocapFrame
from mock_autopilot.fault_mocap import MocapFaults
from mock_autopilot.fault_schedule import Turn
from mock_autopilot.fault_words import parse
from mock_autopilot.qtm_camera import Camera
from mock_autopilot.qtm_packets import Frame
from mock_autopilot.qualisys_config import QualisysConfig
from mock_autopilot.streams import TICK_S
from mock_autopilot.truth import Truth
from tests.dead_man import NoDeadMan
from tests.flights.simulated_servos import SimulatedServos
from tests.mock_autopilot.bench import NO_GPS, Bench, Sent

_MODES = {0x00060000: FlightMode.OFFBOARD, 0x03040000: FlightMode.HOLD, 0x06040000: FlightMode.LAND}
ARMED_BIT = 128
ON_GROUND = 1


class Room:
    """Vehicle, cameras and time."""

    def __init__(
        self,
        seed: int,
        plant: dict[str, Any] | None = None,
        mocap: dict[str, Any] | None = None,
        start: dict[str, Any] | None = None,
        arms: dict[str, Any] | None = None,
        faults: Sequence[str] = (),
    ) -> None:
        heavy = {"mass_kg": 4.85, "max_thrust_n": 95.1}
        params = NO_GPS | {"COM_OBL_RC_ACT": 4}
        self.bench = Bench(params, heavy | (plant or {}), seed=seed, vehicle=start, arms=arms, faults=faults)
        self.bench.setpoint_period_s = 0.05  # MAVSDK re-sends the last setpoint at 20 Hz by itself
        cameras, world = QualisysConfig.model_validate(mocap or {}), self.bench.world
        self._camera = Camera(cameras, seed)
        self._faults = MocapFaults(world.faults, world.fault_rng(), cameras.rate_hz)
        self.fault_turns: list[Turn] = []
        """Every fault that began or ended, and when."""
        world.faults.observers.append(self.fault_turns.append)
        self.frame: MocapFrame | None = None
        self.new_frame = False
        self.offset_w_m = np.zeros(3)
        """What motion capture is wrong by, from now on."""
        self.bench.world.observers.append(self._look)

    def now_s(self) -> float:
        """ports.Clock: simulated time."""
        return self.bench.now_s

    def inject(self, sentence: str) -> None:
        """Let something go wrong, from now on or when its time comes: "mocap stuck for 2 s" (docs/faults.md)."""
        self.bench.world.inject(parse(sentence))

    @property
    def truth_w_m(self) -> Array:
        """Where the vehicle really is, W."""
        return flip_yz(self.bench.world.truth.position_ned_m)

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
            seen = _received(frame, truth.time_s)
            self.frame, self.new_frame = replace(seen, position_w_m=seen.position_w_m + self.offset_w_m), True


def _received(frame: Frame, now_s: float) -> MocapFrame:
    pose = frame.bodies[0]
    return MocapFrame(
        frame.number, frame.stamp_us * 1e-6, now_s, pose.position_room_m, pose.rotation_room_flu, pose.residual_m
    )


class SimulatedMocap:
    """ports.MocapSource."""

    def __init__(self, room: Room, every_tick: Callable[[], None]) -> None:
        self._room, self._every_tick = room, every_tick
        self.lost_at_s = math.inf
        """Then the connection breaks, which ends the flight loop."""

    def latest(self) -> MocapFrame | None:
        return self._room.frame

    async def wait_frame(self, timeout_s: float) -> bool:
        await asyncio.sleep(0)
        if self._room.now_s() > self.lost_at_s:
            raise MocapError("the connection to QTM was lost")
        self._every_tick()
        self._room.pass_time(timeout_s)
        fresh, self._room.new_frame = self._room.new_frame, False
        return fresh


class SimulatedAutopilot:
    """ports.Autopilot: MAVLink messages straight into the mock's receiver and out of its sender."""

    def __init__(self, room: Room) -> None:
        self._bench = room.bench
        self.setpoints: list[tuple[float, AttitudeThrust]] = []
        self._beat: Sent | None = None
        self._heard: Sent | None = None
        self._in_air = False
        self.land_calls = 0
        self.deaf_to_land = 0
        """So many land commands are lost."""
        self._read = 0

    def send_setpoint(self, setpoint: AttitudeThrust) -> None:
        self.setpoints.append((self._bench.now_s, setpoint))
        q = flip_quat(setpoint.q_w_flu_wxyz).tolist()
        self._bench.target(float(setpoint.thrust), tuple(q))
        self._bench.hear(self._bench.setpoint)

    def send_vision(self, position_w_m: Array, q_w_flu_wxyz: Array) -> None:
        x, y, z = flip_yz(position_w_m).tolist()
        w, i, j, k = flip_quat(q_w_flu_wxyz).tolist()
        roll, pitch = np.arctan2(2 * (w * i + j * k), 1 - 2 * (i * i + j * j)), np.arcsin(2 * (w * j - k * i))
        yaw = np.arctan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k))
        self._bench.hear(mavlink.MAVLink_vision_position_estimate_message(0, x, y, z, roll, pitch, yaw, [np.nan] * 21))

    def status(self) -> AutopilotStatus:
        """As the last HEARTBEAT showed it: up to a second old, as over the real link."""
        for sent in self._bench.sent[self._read :]:
            if sent.type == "HEARTBEAT":
                self._beat = sent
            if sent.type == "EXTENDED_SYS_STATE":
                self._in_air = sent.message.landed_state != ON_GROUND
            if sent.type == "ATTITUDE_QUATERNION":
                self._heard = sent
        self._read = len(self._bench.sent)
        level = np.array([1.0, 0.0, 0.0, 0.0])
        if self._beat is None:
            return AutopilotStatus(False, 0.0, False, FlightMode.OTHER, False, 1.0, 16.0, level, "")
        beat = self._beat
        armed = bool(beat.message.base_mode & ARMED_BIT)
        mode = _MODES.get(beat.message.custom_mode, FlightMode.OTHER)
        if mode is not FlightMode.OFFBOARD:
            self._bench.setpoint = None  # MAVSDK stops its stream when a HEARTBEAT shows another mode
        heard = self._heard.message if self._heard is not None else None
        heard_s = self._heard.time_s if self._heard is not None else -math.inf
        q = level if heard is None else flip_quat(np.array([heard.q1, heard.q2, heard.q3, heard.q4]))
        boot_s = math.nan if heard is None else heard.time_boot_ms * 1e-3
        return AutopilotStatus(True, beat.time_s, armed, mode, self._in_air, 1.0, 16.0, q, "", heard_s, boot_s)

    def stop_stream(self) -> None:
        self._bench.setpoint = None

    async def start_offboard(self) -> None:
        self.command(176, 1.0, 6.0, 0.0)

    async def arm(self) -> None:
        self.command(400, 1.0)

    async def disarm(self) -> None:
        """Ask again every half second for 5 s, as the real adapter does."""
        for _ in range(10):
            self.command(400, 0.0)
            await self._pass_time(0.5)
            if not self._bench.world.vehicle.armed:
                return
        raise AutopilotError("still armed")

    async def _pass_time(self, for_s: float) -> None:
        end_s = self._bench.now_s + for_s
        while self._bench.now_s < end_s:  # noqa: ASYNC110 - simulated time, no event tells of it
            await asyncio.sleep(0)

    async def land(self) -> None:
        self.land_calls += 1
        if self.deaf_to_land:
            self.deaf_to_land -= 1
            raise AutopilotError("the autopilot did not answer the command to land")
        self.command(21)

    async def kill(self) -> None:
        self.command(400, 0.0, 21196.0)

    def command(self, command: int, *params: float) -> None:
        """One COMMAND_LONG, unused parameters NaN as MAVSDK sends them."""
        filled = [*params, *[np.nan] * (7 - len(params))]
        self._bench.hear(mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled))


async def _time_goes_on(room: Room, cameras: SimulatedMocap) -> None:
    """Once nobody waits for frames any more, time passes by itself."""
    while True:
        await asyncio.sleep(0.01)
        if room.now_s() > cameras.lost_at_s:
            room.new_frame = False
            room.pass_time(0.01)


Step = Callable[["Flight"], bool]
"""Called every cycle; True when it is done and the next one begins."""


@dataclass(repr=False)  # thousands of ticks
class Flight:
    """A flight in progress, for the script that commands it and the checks afterwards."""

    room: Room
    autopilot: SimulatedAutopilot
    loop: FlightLoop
    servos: SimulatedServos | None
    ticks: list[Tick] = field(default_factory=list)
    truths_w_m: list[Array] = field(default_factory=list)
    """Where the vehicle really was at each tick."""

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


class FlightTimeoutError(AssertionError):
    """The script did not end in time."""


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
    longest_s: float = 120.0,
) -> Flight:
    """Run the loop until the script has ended; raises what the loop raises."""
    config = config or CompanionConfig(arms=ArmsConfig() if arms is not None else None)
    law = load_controller(controller, config.vehicle_model(), 0.01).law if isinstance(controller, str) else controller
    room = Room(seed, plant, mocap, start, arms, faults)
    done = asyncio.Event()
    steps = list(script)

    def every_tick() -> None:
        if steps and steps[0](flight):
            steps.pop(0)
        if room.now_s() > longest_s:
            raise FlightTimeoutError(f"{len(steps)} steps of the script are left, phase {flight.phase}")
        if not steps:
            done.set()

    def sink(tick: Tick) -> None:
        flight.ticks.append(tick)
        flight.truths_w_m.append(room.truth_w_m)
        if room.now_s() > raise_in_sink_at_s:
            raise BrokenPipeError("nobody reads this any more")

    autopilot = SimulatedAutopilot(room)
    autopilot.deaf_to_land = lost_land_commands
    servos = SimulatedServos(room) if arms is not None else None
    cameras = SimulatedMocap(room, every_tick)
    cameras.lost_at_s = mocap_lost_at_s
    loop = FlightLoop(Devices(cameras, autopilot, room, NoDeadMan(), servos), law, config, sink)
    flight = Flight(room, autopilot, loop, servos)
    running = asyncio.create_task(loop.run(), name="flight")
    waiting = asyncio.create_task(done.wait(), name="script")
    clock = asyncio.create_task(_time_goes_on(room, cameras), name="clock")
    try:
        await asyncio.wait({running, waiting}, return_when=asyncio.FIRST_COMPLETED)
        if running.done():
            running.result()
    finally:
        for task in (running, waiting, clock):
            task.cancel()
        await asyncio.gather(running, waiting, clock, return_exceptions=True)
    return flight
