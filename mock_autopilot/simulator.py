"""The simulator: physics, links and cameras in simulated time that follows the wall clock without drift."""

import asyncio
import contextlib
import time
from dataclasses import replace

from mock_autopilot.config import MockConfig
from mock_autopilot.faults.catalogue import DOWN, UP, Part
from mock_autopilot.faults.mocap import FleetMocapFaults, MocapFaults
from mock_autopilot.faults.network import impairment_of
from mock_autopilot.faults.schedule import FaultTransition
from mock_autopilot.fleet.config import fleet_cameras, vehicle_config
from mock_autopilot.fleet.fleet import Fleet
from mock_autopilot.impairment.ports import PortPair
from mock_autopilot.impairment.relays import Relay, open_relays
from mock_autopilot.impairment.sentences import Directions, parse_directions
from mock_autopilot.mavlink.link import MavlinkLink
from mock_autopilot.mavlink.streams import TICK_S
from mock_autopilot.qtm.server import QualisysServer
from mock_autopilot.servos.bus import ServoBus
from mock_autopilot.world import World

LONGEST_CATCH_UP_S = 5.0
"""After a longer pause (a suspended laptop) simulated time skips the pause."""


class Simulator:
    """One world, or a fleet's, with its links, cameras and servo buses; use `async with`."""

    def __init__(self, config: MockConfig, seed: int, with_qualisys: bool = True) -> None:
        self.fleet = Fleet(config, seed) if config.fleet.vehicles > 1 else None
        """None for a single vehicle, which is simulated without the cost of one."""
        self.worlds = [World(config, seed)] if self.fleet is None else self.fleet.worlds
        self.world = self.worlds[0]
        """The first vehicle's."""
        self._room: World | Fleet = self.world if self.fleet is None else self.fleet
        each = [vehicle_config(config, number) for number in range(1, len(self.worlds) + 1)]
        self.links: list[MavlinkLink] = []
        """Of all vehicles."""
        for one, world in zip(each, self.worlds, strict=True):
            self.links.append(MavlinkLink(one.mavlink, world))
            if config.gcs.enabled:
                self.links.append(MavlinkLink(one.gcs, world, faulty=False))
        self.qualisys: QualisysServer | None = self._cameras(config, seed) if with_qualisys else None
        self.servo_buses = [
            ServoBus(one.arms.bus, self.catch_up, world.servos)
            for one, world in zip(each, self.worlds, strict=True)
            if world.servos is not None
        ]
        """Of all vehicles with arms."""
        self._pairs = [relay.pair() for relay in config.impairment.relays]
        self._relays: list[Relay] = []
        self._relays_open = contextlib.AsyncExitStack()
        for world in self.worlds:
            world.faults.observers.append(self._on_network)
        self._seed = seed
        for part, text in (("mavlink", config.impairment.mavlink), ("qtm", config.impairment.qtm)):
            self.impair(part, parse_directions(text))
        self._boot_s = 0.0
        self._ticks = 0
        self._running: asyncio.Task[None] | None = None

    def _cameras(self, config: MockConfig, seed: int) -> QualisysServer:
        """Return the server of all vehicles' bodies."""
        rate_hz = config.qualisys.rate_hz
        if self.fleet is None:
            server = QualisysServer(
                config.qualisys, seed, MocapFaults(self.world.faults, self.world.fault_rng(), rate_hz)
            )
            self.world.observers.append(server.publish)
            return server
        faults = [
            MocapFaults(world.faults, world.fault_rng(), rate_hz, place, alone=True)
            for place, world in enumerate(self.worlds)
        ]
        server = QualisysServer(fleet_cameras(config), seed, FleetMocapFaults(faults))
        self.fleet.observers.append(lambda truths: server.publish(truths[0], truths[1:]))
        return server

    @property
    def servo_bus(self) -> ServoBus | None:
        """Return the first vehicle's servo bus; None without arms."""
        return self.servo_buses[0] if self.servo_buses else None

    @property
    def started_s(self) -> float:
        """Return the time.monotonic() at which simulated time was 0."""
        return self._boot_s

    async def __aenter__(self) -> "Simulator":
        try:
            for link in self.links:
                link.open()
            for bus in self.servo_buses:
                bus.open()
            if self.qualisys is not None:
                await self.qualisys.start()
            self._relays = await self._relays_open.enter_async_context(open_relays(self._pairs, self._seed))
        except BaseException:
            self._close_links()
            raise
        self._boot_s = time.monotonic()
        loop = asyncio.get_running_loop()
        for link in self.links:
            loop.add_reader(link.fileno(), self.catch_up)
        self._running = asyncio.create_task(self._run(), name="mock_autopilot.simulator")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._running is not None:
            self._running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._running
        loop = asyncio.get_running_loop()
        for link in self.links:
            loop.remove_reader(link.fileno())
        self._close_links()
        await self._relays_open.aclose()
        if self.qualisys is not None:
            await self.qualisys.stop()

    @property
    def relayed(self) -> list[PortPair]:
        """Return the port pairs as they are open, with the ports that were free."""
        return [
            replace(pair, listen=(pair.listen[0], relay.port))
            for pair, relay in zip(self._pairs, self._relays, strict=True)
        ]

    def impair(self, part: str, link: Directions) -> None:
        """Impair "mavlink", "qtm" or all port pairs ("network") from now on; ValueError for another part."""
        if part == "mavlink":
            for number, onboard in enumerate(each for each in self.links if not each.for_gcs):
                onboard.impair(link, self._seed + number)
        elif part == "qtm":
            if self.qualisys is not None:
                self.qualisys.impair(link)
        elif part == "network":
            self._pairs = [replace(pair, link=link) for pair in self._pairs]
            self._set_relays()
        else:
            raise ValueError(f'"{part}" cannot be impaired; possible: mavlink, qtm, network')

    def _on_network(self, turn: FaultTransition) -> None:
        if turn.fault.part is Part.NETWORK:
            self._set_relays()

    def _set_relays(self) -> None:
        held = tuple(fault for world in self.worlds for fault in world.faults.active(Part.NETWORK))
        for pair, relay in zip(self._pairs, self._relays, strict=False):  # none before they are open
            relay.set(up=impairment_of(held, UP, pair.link.up), down=impairment_of(held, DOWN, pair.link.down))

    def _close_links(self) -> None:
        for link in self.links:
            link.close()
        for bus in self.servo_buses:
            bus.close()

    async def wait(self) -> None:
        """Wait until cancelled; raise the exception that ended the simulation."""
        if self._running is not None:
            await asyncio.shield(self._running)

    async def _run(self) -> None:
        while True:
            self.catch_up()
            next_s = self._boot_s + (self._ticks + 1) * TICK_S
            await asyncio.sleep(max(next_s - time.monotonic(), 0.0))

    def catch_up(self) -> None:
        """Bring the world to the present; datagrams that came in meanwhile act at their time of arrival."""
        heard = [(datagram, link) for link in self.links for datagram in link.receive()]
        heard.sort(key=lambda pair: pair[0].arrived_s)
        now_s = time.monotonic()
        behind_s = now_s - self._boot_s - self._room.time_s
        if behind_s > LONGEST_CATCH_UP_S:
            self._boot_s += behind_s - LONGEST_CATCH_UP_S
        for datagram, link in heard:
            self._advance(datagram.arrived_s - self._boot_s)
            for frame in link.handle(datagram.payload):
                for other in self.links:
                    if other is not link and other.world is link.world:
                        other.forward(frame)
        self._advance(now_s - self._boot_s)

    def _advance(self, to_s: float) -> None:
        while (self._ticks + 1) * TICK_S <= to_s:
            self._ticks += 1
            self._room.advance(self._ticks * TICK_S)
            self._tell()
            for link in self.links:
                link.send_due()
        self._room.advance(to_s)

    def _tell(self) -> None:
        for world in self.worlds:
            texts = world.vehicle.pop_texts()
            if texts:
                for link in self.links:
                    if link.world is world:
                        link.tell(texts)
