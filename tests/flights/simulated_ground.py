"""The law on the ground in simulated time: the real law, loop and ends of the link, and a network that fails."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from random import Random
from typing import Any, Protocol

from companion.adapters.law_link.udp import Address, GroundLink, VehicleLink, introduction
from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import LawConfig
from companion.control.controller import Controller
from companion.core.interfaces import Clock
from companion.core.types import MocapFrame
from companion.flight.assembly import controller_of, with_link
from companion.flight.tick_timer import TickTimer
from companion.ground.ground_law import GroundLaw, GroundParts
from companion.ground.ground_loop import GroundLoop
from companion.ground.ground_service import parts_of
from companion.ground.ground_tick import GroundTick
from companion.law_link.agreement import Agreed, Introduction
from companion.law_link.ground_end import GroundEnd
from companion.law_link.messages import UpFlags
from companion.law_link.vehicle_end import VehicleEnd
from mock_autopilot.faults.catalogue import DOWN, UP
from mock_autopilot.faults.network import NetworkFaults
from mock_autopilot.faults.schedule import FaultSchedule
from mock_autopilot.impairment import parse

KEY = b"the key of this room's vehicle"
VEHICLE: Address = ("vehicle", 14600)
USUAL = "delay 3 ms"
"""Wi-Fi, and the time that the law takes: longer than from a frame's arrival to the vehicle's cycle."""


@dataclass(frozen=True, kw_only=True)
class GroundSetup:
    """Conditions of the ground and its network when a flight begins."""

    link: str = USUAL
    """Impairment of either direction, in the mock's words."""
    clock_offset_s: float = 1234.5
    """Ground's clock less the vehicle's."""
    version: str | None = None
    """Version of the ground's software, if it is another one."""
    differs: Agreed = field(default_factory=dict)
    """Values of the ground's configuration that differ from the vehicle's."""


def ground_config(config: CompanionConfig, onboard_mocap: bool) -> CompanionConfig:
    """Return a configuration with the law on the ground; its key is given otherwise."""
    law = LawConfig().model_copy(update={"runs_on": "ground", "onboard_mocap": onboard_mocap})
    return config.model_copy(update={"law": law})


class Room(Protocol):
    """Room with its cameras and its clock, which is the vehicle's."""

    @property
    def frame(self) -> MocapFrame | None:
        """Newest frame."""

    @property
    def faults(self) -> FaultSchedule:
        """Faults that are injected."""

    def now_s(self) -> float:
        """Simulated time."""


@dataclass
class Datagram:
    """One datagram on its way."""

    data: bytes
    source: Address
    to: Address
    sent_s: float
    confirms: bool = False
    """A ground law of the right key that sees and computes has sent it."""


class SimulatedNetwork:
    """Network between the vehicle and its grounds, with the room's faults of a network."""

    def __init__(self, room: Room, sentence: str, seed: int) -> None:
        self._room, usual = room, parse(sentence)
        self._up: NetworkFaults[Datagram] = NetworkFaults(room.faults, UP, usual, seed)
        self._down: NetworkFaults[Datagram] = NetworkFaults(room.faults, DOWN, usual, seed)
        self._arrived: list[Datagram] = []
        self.sent_up: list[Datagram] = []
        """Everything that was ever sent to the vehicle, for those who listen in and play it again."""

    def send(self, datagram: Datagram) -> None:
        """Take what somebody sends now."""
        up = datagram.to == VEHICLE
        if up:
            self.sent_up.append(datagram)
        way = self._up if up else self._down
        self._arrived += way.pass_on([datagram], self._room.now_s(), len(datagram.data))

    def arrived(self) -> list[Datagram]:
        """Return what arrives now, each once."""
        now_s = self._room.now_s()
        arrived = [*self._arrived, *self._up.pass_on([], now_s), *self._down.pass_on([], now_s)]
        self._arrived.clear()
        return arrived


class _Socket(asyncio.DatagramTransport):
    """Socket of one end."""

    def __init__(
        self, network: SimulatedNetwork, clock: Clock, source: Address, confirms: Callable[[], bool] = lambda: False
    ) -> None:
        super().__init__()
        self._network, self._clock, self._source, self._confirms = network, clock, source, confirms

    def sendto(self, data: Any, addr: Any = None) -> None:
        """Send to an address, or to the vehicle."""
        now_s = self._clock.now_s()
        self._network.send(Datagram(bytes(data), self._source, addr or VEHICLE, now_s, self._confirms()))


class _GroundMocap:
    """interfaces.MocapSource of the ground, as far as a cycle asks."""

    def __init__(self) -> None:
        self.frame: MocapFrame | None = None

    def latest(self) -> MocapFrame | None:
        return self.frame

    def why_silent(self) -> str:
        return ""

    async def wait_frame(self, timeout_s: float) -> bool:
        raise NotImplementedError("here frames come by `SimulatedGround.step`")


class SimulatedGround:
    """One computer on the ground with `companion law` on it; `step` lets it live."""

    def __init__(self, world: "GroundWorld", me: Introduction, parts: GroundParts, key: bytes) -> None:
        self._world, self._parts, self._key = world, parts, key
        self.address: Address = (me.host, 14600)
        self.offset_s = world.setup.clock_offset_s
        self.stopped = False
        """It gets no time; its socket and its cameras' newest frame wait."""
        self.sees = True
        """Its frames come."""
        self.ticks: list[GroundTick] = []
        self._begin(me)

    def _begin(self, me: Introduction) -> None:
        world = self._world
        end = GroundEnd(self._key, me, world.random, beat_s=0.03)
        self.link = GroundLink(end, self)
        self.link.opened(_Socket(world.network, world.room, self.address, self._confirms))
        self.law = GroundLaw(end, self._parts, me.law, world.law(self._parts.delay_s))
        self._mocap, self._waiting = _GroundMocap(), list[Datagram]()
        self._loop = GroundLoop(self._mocap, self.link, self.law, self, self._parts.period_s)
        self._loop.observers.append(self.ticks.append)
        self._timer = TickTimer(self._parts.period_s, self.now_s() + self._parts.period_s)

    def _confirms(self) -> bool:
        flags = self.link.end.flags
        return self._key == self._world.key and not flags & (UpFlags.BLIND | UpFlags.FAILED)

    def now_s(self) -> float:
        """interfaces.Clock: the ground's own."""
        return self._world.room.now_s() + self.offset_s

    def hear(self, datagram: Datagram) -> None:
        """Take a datagram into the socket."""
        self._waiting.append(datagram)

    def step(self, frame: MocapFrame | None) -> None:
        """Live on until now; `frame` is new, or None."""
        if frame is not None and self.sees:
            self._mocap.frame = replace(frame, received_s=self.now_s())
        else:
            frame = None
        if self.stopped:
            return
        for datagram in self._waiting:
            self.link.hear(datagram.data, datagram.source)
        self._waiting.clear()
        now_s = self.now_s()
        due = frame is not None and not self._timer.frame_is_early(now_s)
        if due or now_s >= self._timer.deadline_s:
            self._timer.begin(now_s, now_s if due else None)
            self._loop.cycle(now_s)
            age_s = self.law.wants_law_for_s
            if age_s is not None:
                self.law.adopt(self._world.law(age_s), age_s)


class GroundWorld:
    """Network, vehicle's end and all grounds of one flight; `step` lets them live."""

    def __init__(
        self, room: Room, setup: GroundSetup, config: CompanionConfig, law: str | Controller, seed: int
    ) -> None:
        self.room, self.setup, self.key = room, setup, KEY
        self.random: Callable[[int], bytes] = Random(seed).randbytes
        self.network = SimulatedNetwork(room, setup.link, seed)
        self._me = introduction(config, law if isinstance(law, str) else type(law).__name__)
        self.end = VehicleEnd(self.key, replace(self._me, law=""), self.random)
        self.vehicle = VehicleLink(self.end, room)
        self.vehicle.opened(_Socket(self.network, room, VEHICLE))
        self._parts, self._config, self._law = parts_of(config), config, law
        self._grounds: dict[Address, SimulatedGround] = {}
        self.all_grounds: list[SimulatedGround] = []
        """Every ground law that was ever started."""
        self.heard: list[tuple[float, Datagram]] = []
        """Every datagram that came to the vehicle, and when."""
        self._frame: MocapFrame | None = None
        agreed = {**self._me.agreed, **setup.differs}
        self.ground = self.begin("ground", version=setup.version or self._me.version, agreed=agreed)

    def law(self, up_age_s: float) -> Controller:
        """Return the law for commands that are this old when they are used (s)."""
        law = self._law
        return controller_of(with_link(self._config, up_age_s), law).law if isinstance(law, str) else law

    def begin(self, host: str, key: bytes | None = None, **changes: Any) -> SimulatedGround:
        """Start a ground law on a computer; `changes` are of how it introduces itself."""
        ground = SimulatedGround(self, replace(self._me, host=host, **changes), self._parts, key or self.key)
        self._grounds[ground.address] = ground
        self.all_grounds.append(ground)
        return ground

    def kill(self, ground: SimulatedGround) -> None:
        """End its process."""
        del self._grounds[ground.address]

    def step(self) -> None:
        """Let the network and all grounds live until now."""
        newest = self.room.frame
        fresh = newest if newest is not self._frame else None
        self._frame = newest
        for datagram in self.network.arrived():
            if datagram.to == VEHICLE:
                self.heard.append((self.room.now_s(), datagram))
                self.vehicle.hear(datagram.data, datagram.source)
            elif datagram.to in self._grounds:
                self._grounds[datagram.to].hear(datagram)
        for ground in list(self._grounds.values()):
            ground.step(fresh)
