"""The MAVLink end: one UDP link as PX4 has it.

It sends to one address from boot on, with or without a client, and listens on its own port; answers go to that same
address whatever the sender. One frame per datagram, system MAV_SYS_ID, component 1. Recorded behaviour:
docs/px4-conformance.md.
"""

import contextlib
import socket
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.config import GcsLinkConfig, LinkConfig
from mock_autopilot.faults.catalogue import FROM, TO
from mock_autopilot.faults.link import LinkFaults
from mock_autopilot.faults.schedule import FaultSchedule
from mock_autopilot.impairment.direction import ImpairedDirection
from mock_autopilot.impairment.sentences import Directions
from mock_autopilot.mavlink.extras import GimbalChatter
from mock_autopilot.mavlink.frames import messages_in
from mock_autopilot.mavlink.messages import Message
from mock_autopilot.mavlink.messages_status import event
from mock_autopilot.mavlink.receiver import Receiver
from mock_autopilot.mavlink.streams import Streams
from mock_autopilot.px4.vocabulary import LandedState, Text
from mock_autopilot.world import World

GCS_TYPE = 6
GCS_SILENT_AFTER_S = 2.5
"""A ground station not heard for this long gets no texts."""
TEXTS_FROM_S = 2.3
"""Texts of the first moments after boot are held back until then."""
TEXT_PERIOD_S = 0.05
"""PX4 sends no more than 20 texts a second; on its 4 ms ticks the second of two comes after 52 ms."""
CHUNK = 50
"""Characters one STATUSTEXT holds."""
SO_TIMESTAMPNS = 35
"""Linux: the kernel stamps each datagram on arrival (missing in Python's socket module)."""
MAX_DATAGRAM = 2048


class LinkError(RuntimeError):
    """The port cannot be used; the message is one sentence for a person."""


@dataclass(frozen=True)
class Datagram:
    """A datagram and its time of arrival by time.monotonic()."""

    arrived_s: float
    payload: bytes


class MavlinkLink:
    """One link; `open` binds the port, `handle` takes datagrams, `send_due` sends the messages that are due."""

    def __init__(self, config: LinkConfig, world: World, faulty: bool = True) -> None:
        """Prepare a closed link; `faulty`: the faults of the part "link" apply to it."""
        self._config = config
        self.world = self._world = world
        self._remote = (config.remote_host, config.remote_port)
        self._codec = mavlink.MAVLink(None, srcComponent=1)
        self._socket: socket.socket | None = None
        schedule, rng = (world.faults if faulty else FaultSchedule()), world.fault_rng()
        self._outgoing, self._incoming = LinkFaults(schedule, rng, FROM), LinkFaults(schedule, rng, TO)
        self._air: tuple[ImpairedDirection[Any], ImpairedDirection[Any]] | None = None
        self._boot()

    def impair(self, link: Directions, seed: int = 1) -> None:
        """Impair the link from now on, `up` being to the autopilot; a perfect one costs nothing."""
        if self._air is None and link == Directions():
            return
        if self._air is None:
            self._air = ImpairedDirection(link.up, 2 * seed, seed), ImpairedDirection(link.down, 2 * seed + 1, seed)
        for direction, impairment in zip(self._air, (link.up, link.down), strict=True):
            direction.set(impairment)

    def _boot(self) -> None:
        """Reset the link's state, as a reboot of PX4 does: clients, streams, queues."""
        self._boots = self._world.boots
        self._gcs_heard_s = -GCS_SILENT_AFTER_S
        self._texts: list[Text] = []
        self._text_due_s = TEXTS_FROM_S
        self._text_id = 0
        self._events: list[Message] = []
        self._chatter = GimbalChatter()
        self.streams = Streams(for_gcs=self.for_gcs)
        self._codec.srcSystem = int(self._world.vehicle.params["MAV_SYS_ID"])
        self._receiver = Receiver(self._world, self.streams, self.send)

    @property
    def for_gcs(self) -> bool:
        """Return whether it is the ground station's."""
        return isinstance(self._config, GcsLinkConfig)

    # -- socket ----------------------------------------------------------------------------------

    def open(self) -> None:
        """Bind the port; raise LinkError when it is taken."""
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.setblocking(False)
        with contextlib.suppress(OSError):  # not Linux: datagrams count as arrived when they are read
            sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        try:
            sock.bind(("127.0.0.1", self._config.local_port))
        except OSError as error:
            sock.close()
            raise LinkError(
                f"MAVLink cannot use UDP port {self._config.local_port} ({error.strerror}): "
                "stop the other program on that port or choose another with --listen"
            ) from error
        self._socket = sock

    def close(self) -> None:
        """Close the socket and release the port."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def fileno(self) -> int:
        """Return the socket's file descriptor for the event loop; -1 when it is closed."""
        return -1 if self._socket is None else self._socket.fileno()

    @property
    def local_port(self) -> int:
        """Return the port that it listens on, also when the configuration has 0 (any free port)."""
        return self._config.local_port if self._socket is None else int(self._socket.getsockname()[1])

    @property
    def remote(self) -> tuple[str, int]:
        """Return host and port to which every frame is sent."""
        return self._remote

    def receive(self) -> list[Datagram]:
        """Return all waiting datagrams with their arrival times."""
        waiting: list[Datagram] = []
        while self._socket is not None:
            try:
                payload, ancillary, _flags, _sender = self._socket.recvmsg(MAX_DATAGRAM, 64)
            except BlockingIOError:
                break
            except OSError:
                continue  # "connection refused" of a client that went away; its successor is welcome
            waiting.append(Datagram(_arrival_s(ancillary), payload))
        return waiting

    def send(self, message: Message) -> None:
        """Send one message; a missing client is no error."""
        self._put(self._packed(message))

    def _packed(self, message: Message) -> Any:
        frame = bytes(message.pack(self._codec))
        self._codec.seq = (self._codec.seq + 1) % 256
        return frame

    def _put(self, *frames: Any) -> None:
        """Send frames, and with them those that a fault held back until now."""
        for frame in self._through_the_air(self._outgoing.pass_on(frames, self._world.time_s), up=False):
            self._transmit(frame)

    def _through_the_air(self, sent: Sequence[Any], up: bool) -> Sequence[Any]:
        """Return what arrives now over the impaired link when `sent` is sent now."""
        if self._air is None:
            return sent
        now_s, direction = self._world.time_s, self._air[0 if up else 1]
        for item in sent:
            direction.put(now_s, item)
        return direction.due(now_s)

    def _transmit(self, frame: Any) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(frame, self._remote)

    # -- protocol --------------------------------------------------------------------------------

    def handle(self, payload: bytes) -> list[bytes]:
        """Act on one datagram, ignoring bytes that are not MAVLink; return the frames for the other links."""
        arrived = self._through_the_air(self._incoming.pass_on([payload], self._world.time_s), up=True)
        return [frame for one in arrived for frame in self._understand(one)]

    def _understand(self, payload: bytes) -> list[bytes]:
        heartbeats: list[bytes] = []
        if not self._world.vehicle.injected_faults.running:
            return heartbeats
        for message in messages_in(payload, self._codec):
            if message.get_type() == "HEARTBEAT":
                heartbeats.append(bytes(message.get_msgbuf()))
                if message.type == GCS_TYPE:
                    self._gcs_heard_s = self._world.uptime_s
            self._receiver.handle(message)
        return heartbeats

    def forward(self, frame: bytes) -> None:
        """Pass on what came in on another link, as it came."""
        self._put(frame)

    def tell(self, texts: list[Text]) -> None:
        """Queue texts for the ground station; without one they are lost, as PX4's are, though not as events."""
        if not texts:
            return
        told, at_ms = self._world.vehicle.commander.events_told, round(self._world.uptime_s * 1e3)
        events = (event(text.text, told - len(texts) + number, at_ms) for number, text in enumerate(texts, start=1))
        self._events += [one for one in events if one is not None]
        if self._world.uptime_s - self._gcs_heard_s < GCS_SILENT_AFTER_S or self._world.uptime_s < TEXTS_FROM_S:
            self._texts += texts

    def send_due(self) -> None:
        """Send the messages of streams and queues that are due."""
        self._put()
        late: Sequence[bytes] = self._through_the_air(self._incoming.pass_on((), self._world.time_s), up=True)
        for payload in late:
            self._understand(payload)  # its heartbeats are not forwarded
        if self._boots != self._world.boots:
            self._boot()
        if not self._world.vehicle.injected_faults.running:
            return
        for message in (*self._receiver.pop_answers(), *self.streams.due(self._world)):
            self.send(message)
        landing = self._world.vehicle.landed_state is LandedState.LANDING
        for message in (*self._receiver.pop_due(), *self._chatter.due(self._world.uptime_s, landing)):
            self.send(message)
        if self._events:
            events, self._events = self._events, []
            for one in events:
                self.send(one)
        if self._texts and self._world.uptime_s >= self._text_due_s - 1e-6:
            self._text_due_s = self._world.uptime_s + TEXT_PERIOD_S
            self._send_text(self._texts.pop(0))

    def _send_text(self, text: Text) -> None:
        if self._world.uptime_s - self._gcs_heard_s >= GCS_SILENT_AFTER_S:
            return
        raw = text.text.encode()
        self._text_id = self._text_id % 65535 + 1
        for sequence, start in enumerate(range(0, len(raw), CHUNK)):
            part = raw[start : start + CHUNK]
            self.send(mavlink.MAVLink_statustext_message(int(text.severity), part, self._text_id, sequence))


def _arrival_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    """Return the kernel's arrival stamp on the monotonic clock; the present time where there is none."""
    now_s = time.monotonic()
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == SO_TIMESTAMPNS and len(data) >= 16:
            seconds, nanoseconds = struct.unpack_from("qq", data)
            age_s = time.time() - (seconds + nanoseconds * 1e-9)
            return now_s - float(min(max(age_s, 0.0), 10.0))
    return now_s
