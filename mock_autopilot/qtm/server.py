"""A simulated Qualisys Track Manager: its real-time server, protocol 1.25, over TCP and UDP."""

import asyncio
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from mock_autopilot.faults.mocap import FrameFaults
from mock_autopilot.impairment.connection import ImpairedConnection
from mock_autopilot.impairment.delivery import TimedDelivery
from mock_autopilot.impairment.direction import ImpairedDirection
from mock_autopilot.impairment.sentences import Directions
from mock_autopilot.physics.truth import Truth
from mock_autopilot.qtm import packets as qtm
from mock_autopilot.qtm.camera import Camera
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.session import NO_MORE_DATA, Session, StreamRequest, bodies_of

MAX_BACKLOG_BYTES = 1_000_000
"""A client with more unread data than this has hung; it is disconnected."""


class ServerStartError(OSError):
    """The server cannot listen at the configured address."""


@dataclass
class QualisysServer:
    """Serves the frames of the truths given to `publish`; start() and stop() frame its life."""

    config: QualisysConfig
    seed: int = 0
    faults: FrameFaults | None = None
    """Faults between cameras and clients, or None."""
    link: Directions = field(default_factory=Directions)
    """Impairment between server and clients; `impair` changes it."""
    capturing: bool = field(default=True, init=False)
    _clients: set["_Client"] = field(default_factory=set, init=False)
    last_frame: qtm.Frame | None = field(default=None, init=False)
    _server: asyncio.Server | None = field(default=None, init=False)
    _udp: asyncio.DatagramTransport | None = field(default=None, init=False)
    _camera: Camera = field(init=False)
    _frames: "ImpairedDirection[tuple[bytes, tuple[str, int]]]" = field(init=False)
    _frames_delivery: "TimedDelivery[tuple[bytes, tuple[str, int]]] | None" = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._camera = Camera(self.config, self.seed)
        if self.faults is not None:
            self.faults.when_bodies_change(self.tell_change)

    @property
    def port(self) -> int:
        """The TCP port it listens on, also when the configuration left the choice open (0)."""
        return int(self._server.sockets[0].getsockname()[1]) if self._server else self.config.port

    @property
    def client_count(self) -> int:
        """Return the number of connected clients."""
        return len(self._clients)

    async def start(self) -> None:
        """Listen; ServerStartError when the address is taken or not of this machine."""
        loop = asyncio.get_running_loop()
        cfg = self.config
        try:
            self._server = await loop.create_server(lambda: _Client(self), cfg.host, cfg.port)
        except OSError as error:
            raise ServerStartError(
                f"the mock Qualisys server cannot listen on {cfg.host}:{cfg.port} ({error.strerror or error}): "
                "stop the other program on that port or choose another port"
            ) from error
        self._udp, _ = await loop.create_datagram_endpoint(_QuietDatagrams, local_addr=(cfg.host, 0))
        self._frames = ImpairedDirection(self.link.down, self.seed, self.seed)
        self._frames_delivery = TimedDelivery(self._frames, self._send_now, time.monotonic())

    async def stop(self) -> None:
        """Say goodbye as a closing QTM does and close every connection."""
        self._broadcast(qtm.event_packet(qtm.Event.SHUTTING_DOWN))
        if self._server is not None:
            self._server.close()
        for client in tuple(self._clients):
            client.close()
        if self._frames_delivery is not None:
            self._frames_delivery.close()
        if self._udp is not None:
            self._udp.close()
        await asyncio.sleep(0)  # lets the transports see their end

    def impair(self, link: Directions) -> None:
        """Impair the link to the clients from now on; `down` is from the server to them."""
        self.link = link
        if self._frames_delivery is not None:
            self._frames_delivery.set(link.down)
        for client in tuple(self._clients):
            client.impair(link)

    def publish(self, truth: Truth, others: Sequence[Truth] = ()) -> None:
        """Take the next truth (in order, every few milliseconds of its time) and send the frames that are due.

        `others` are those of more vehicles, the first ones of `config.extra_bodies`.
        """
        frames = self._camera.look(truth, others)
        for frame in frames if self.faults is None else self.faults.pass_on(frames, truth.time_s):
            if self.capturing:
                self.last_frame = frame
                for client in tuple(self._clients):
                    client.send_frame(frame)

    def stop_capture(self) -> None:
        """Stop measuring, as an operator does in QTM: an event and 'no more data' to all who stream."""
        self.capturing, self.last_frame = False, None
        self._broadcast(qtm.event_packet(qtm.Event.CAPTURE_STOPPED))
        for client in tuple(self._clients):
            client.send_no_more_data()

    def start_capture(self) -> None:
        """Measure again; clients that asked for a stream get it again."""
        self.capturing = True
        self._broadcast(qtm.event_packet(qtm.Event.CAPTURE_STARTED))

    def bodies(self) -> tuple[qtm.Body, ...]:
        """QTM's rigid bodies as its settings are now."""
        bodies = bodies_of(self.config)
        return bodies if self.faults is None else self.faults.listed(bodies)

    def tell_change(self) -> None:
        """Send QTM's event for changed settings to all clients."""
        if self.config.tells_changes:
            self._broadcast(qtm.event_packet(qtm.Event.SETTINGS_CHANGED))

    def _broadcast(self, packet: bytes) -> None:
        for client in tuple(self._clients):
            client.send(packet)

    def _send_datagram(self, packet: bytes, address: tuple[str, int]) -> None:
        if self._frames_delivery is not None:
            self._frames.put(self._frames_delivery.now_s, (packet, address), len(packet))
            self._frames_delivery.look()

    def _send_now(self, sent: tuple[bytes, tuple[str, int]]) -> None:
        if self._udp is not None:
            self._udp.sendto(*sent)


class _QuietDatagrams(asyncio.DatagramProtocol):
    """Sends only. A receiver that has gone away answers with an ICMP error, which means nothing to us."""


class _Client(asyncio.Protocol):
    """One TCP connection; asyncio switches Nagle's delay off (TCP_NODELAY) by itself."""

    def __init__(self, server: QualisysServer) -> None:
        self._server = server
        self._session = Session(server.config, bodies=server.bodies)
        self._buffer = bytearray()
        self._transport: asyncio.Transport | None = None
        self._air: ImpairedConnection | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)  # uvloop's is one without inheriting from it
        self._server._clients.add(self)
        self.impair(self._server.link)
        self.send(qtm.text_packet(qtm.PacketType.COMMAND, "QTM RT Interface connected"))

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._transport = None
        if self._air is not None:
            self._air.close()
        self._server._clients.discard(self)

    def impair(self, link: Directions) -> None:
        """Impair the connection from now on; one that never was impaired writes and reads at once."""
        if self._air is not None:
            self._air.set(link)
        elif link != Directions():
            self._air = ImpairedConnection(link, self._server.seed, self._take, self._write)

    def data_received(self, data: bytes) -> None:
        if self._air is not None:
            self._air.received(data)
        else:
            self._take(data)

    def _take(self, data: bytes) -> None:
        self._buffer += data
        try:
            commands = qtm.take_commands(self._buffer)
        except qtm.GarbageError:
            self.close()
            return
        for command in commands:
            for packet in self._session.answer(command, self._server.last_frame, self._server.capturing):
                self.send(packet)

    def send(self, packet: bytes) -> None:
        """Write to the connection, or cut it off when the client reads nothing."""
        if self._transport is None or self._transport.is_closing():
            return
        on_the_way = self._air.waiting_bytes if self._air is not None else 0
        if self._transport.get_write_buffer_size() + on_the_way > MAX_BACKLOG_BYTES:
            self._transport.abort()
            return
        (self._write if self._air is None else self._air.send)(packet)

    def _write(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def send_frame(self, frame: qtm.Frame) -> None:
        """Send a frame the way the client asked for it, if it did."""
        stream = self._session.stream
        if stream is not None and stream.wants(frame.number, self._server.config.rate_hz):
            packet, faults = qtm.data_packet(frame, stream.components), self._server.faults
            self._send_streamed(packet if faults is None else faults.packet(packet), stream)

    def send_no_more_data(self) -> None:
        """Tell a streaming client that the capture has ended."""
        if self._session.stream is not None:
            self._send_streamed(NO_MORE_DATA, self._session.stream)

    def close(self) -> None:
        """Close the connection after what was written has left."""
        if self._transport is not None:
            self._transport.close()

    def _send_streamed(self, packet: bytes, stream: StreamRequest) -> None:
        if stream.udp_port is None:
            self.send(packet)
        elif self._transport is not None:
            host = stream.udp_host or self._transport.get_extra_info("peername")[0]
            self._server._send_datagram(packet, (host, stream.udp_port))
