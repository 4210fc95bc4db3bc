"""The far end of the wire: mocap and autopilot as the mocks have them, with a stamp on every frame out and setpoint in.

Each frame goes to the service, and half a period later to the bare relay: the same bytes, in the same seconds, on the
same machine. Sending is deferred until the simulator has done its work, so that it never competes with the receiver;
a real QTM and a real PX4 are other machines.
"""

import asyncio
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from mock_autopilot.config import LinkConfig, MockConfig
from mock_autopilot.mavlink.link import Datagram, MavlinkLink
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.server import QualisysServer
from mock_autopilot.simulator import Simulator
from mock_autopilot.world import World

LOOPBACK = "127.0.0.1"
SET_ATTITUDE_TARGET = 82
_MAVLINK_2 = 0xFD


def is_setpoint(frame: bytes) -> bool:
    """Return true for bytes that begin with a MAVLink 2 SET_ATTITUDE_TARGET."""
    return len(frame) >= 10 and frame[0] == _MAVLINK_2 and int.from_bytes(frame[7:10], "little") == SET_ATTITUDE_TARGET


@dataclass
class Stamps:
    """Times (s, monotonic) at which frames left and setpoints arrived."""

    frames_s: list[float] = field(default_factory=list)
    setpoints_s: list[float] = field(default_factory=list)


class StampingLink(MavlinkLink):
    """The mock's link; notes the kernel's arrival stamp of every setpoint."""

    def __init__(self, config: LinkConfig, world: World, stamps: Stamps) -> None:
        super().__init__(config, world)
        self._stamps = stamps

    def receive(self) -> list[Datagram]:
        """Pass on all waiting datagrams, with their stamps noted."""
        waiting = super().receive()
        self._stamps.setpoints_s += [datagram.arrived_s for datagram in waiting if is_setpoint(datagram.payload)]
        return waiting


class StampingServer(QualisysServer):
    """The mock's QTM; notes when each frame leaves, and sends it to the relay, too."""

    def __init__(self, config: QualisysConfig, seed: int, service: Stamps, relay: "RelayEnd | None") -> None:
        super().__init__(config, seed)
        self._stamps, self._relay = service, relay
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    async def stop(self) -> None:
        """Close what was opened here, too."""
        self._socket.close()
        await super().stop()

    def _send_datagram(self, packet: bytes, address: tuple[str, int]) -> None:
        asyncio.get_running_loop().call_soon(self._send_stamped, packet, address, self._stamps)
        if self._relay is not None:
            asyncio.get_running_loop().call_later(
                0.5 / self.config.rate_hz, self._send_stamped, packet, self._relay.address, self._relay.stamps
            )

    def _send_stamped(self, packet: bytes, address: tuple[str, int], stamps: Stamps) -> None:
        if self._socket.fileno() < 0:
            return
        stamps.frames_s.append(time.monotonic())
        self._socket.sendto(packet, address)


class RelayEnd:
    """The relay's port, and the socket on which its setpoints are stamped."""

    def __init__(self, receiver: MavlinkLink, stamps: Stamps) -> None:
        self.address = (LOOPBACK, 0)
        self.stamps = stamps
        self._receiver = receiver

    @property
    def port(self) -> int:
        """The port to which the relay sends its setpoints."""
        return self._receiver.local_port

    def take(self) -> None:
        """Note the arrival stamps of all waiting setpoints."""
        self._receiver.receive()


@asynccontextmanager
async def relay_end(world: World) -> AsyncIterator[RelayEnd]:
    """A second link, the same code as the service's, of which nothing but the stamps is used."""
    stamps = Stamps()
    link = StampingLink(LinkConfig(local_port=0), world, stamps)
    link.open()
    end = RelayEnd(link, stamps)
    loop = asyncio.get_running_loop()
    loop.add_reader(link.fileno(), end.take)
    try:
        yield end
    finally:
        loop.remove_reader(link.fileno())
        link.close()


@asynccontextmanager
async def simulated_room(config: MockConfig, service: Stamps, relay: RelayEnd | None) -> AsyncIterator[Simulator]:
    """The mocks, running in this process, with stamps on both ends."""
    simulator = Simulator(config, seed=1, with_qualisys=False)
    simulator.links = [StampingLink(config.mavlink, simulator.world, service)]
    simulator.qualisys = StampingServer(config.qualisys, 1, service, relay)
    simulator.world.observers.append(simulator.qualisys.publish)
    async with simulator:
        yield simulator
