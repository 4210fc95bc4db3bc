"""A relay between an autopilot and its client that writes down what passes, and when the kernel got it."""

import asyncio
import socket
import struct
import time
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.cli.demo.mock_process import MockPorts, free_ports

_SO_TIMESTAMPNS = 35
"""Linux; missing in Python's socket module."""


@dataclass(frozen=True)
class Passed:
    """A message, and when it arrived here by time.monotonic()."""

    time_s: float
    message: Any

    @property
    def kind(self) -> str:
        """Return the message's name in MAVLink."""
        return str(self.message.get_type())


class Relay:
    """Start the autopilot on `ports` and the client on `url`."""

    def __init__(self) -> None:
        self.ports: MockPorts = free_ports()
        self._client_port = free_ports().client
        self._towards_client, self._towards_autopilot = (_stamping_socket() for _ in range(2))
        assert self.ports.client is not None
        self._towards_autopilot.bind(("127.0.0.1", self.ports.client))
        self._towards_client.bind(("127.0.0.1", 0))
        self._codec = mavlink.MAVLink(None)
        self.cut = False
        """Stop passing frames on; they are still recorded."""
        self.from_client: list[Passed] = []
        self.from_autopilot: list[Passed] = []
        """HEARTBEAT, CURRENT_MODE and STATUSTEXT only."""

    @property
    def url(self) -> str:
        """Return the URL at which MAVSDK connects to the relay."""
        return f"udpin://127.0.0.1:{self._client_port}"

    def setpoints_s(self) -> list[float]:
        """Return the times at which attitude setpoints came from the client."""
        return [passed.time_s for passed in self.from_client if passed.kind == "SET_ATTITUDE_TARGET"]

    def __enter__(self) -> "Relay":
        loop = asyncio.get_running_loop()
        loop.add_reader(self._towards_client, self._take_clients)
        loop.add_reader(self._towards_autopilot, self._take_autopilots)
        return self

    def __exit__(self, *_: object) -> None:
        for end in (self._towards_client, self._towards_autopilot):
            asyncio.get_running_loop().remove_reader(end)
            end.close()

    def _take_clients(self) -> None:
        for time_s, payload in _waiting(self._towards_client):
            self.from_client += [Passed(time_s, message) for message in self._messages(payload)]
            if not self.cut:
                _send(self._towards_autopilot, payload, self.ports.autopilot)

    def _take_autopilots(self) -> None:
        for time_s, payload in _waiting(self._towards_autopilot):
            if _number(payload) in _NOTED:
                self.from_autopilot += [Passed(time_s, message) for message in self._messages(payload)]
            if not self.cut:
                _send(self._towards_client, payload, self._client_port)

    def _messages(self, payload: bytes) -> list[Any]:
        return list(self._codec.parse_buffer(payload) or [])


_NOTED = {0, 253, 436}
"""HEARTBEAT, STATUSTEXT, CURRENT_MODE."""


def _number(payload: bytes) -> int:
    """Return the message id of a MAVLink 2 frame; PX4 sends one frame a datagram."""
    return int.from_bytes(payload[7:10], "little")


def _stamping_socket() -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.setblocking(False)
    end.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    return end


def _waiting(end: socket.socket) -> list[tuple[float, bytes]]:
    """Return all waiting datagrams and their times of arrival."""
    found: list[tuple[float, bytes]] = []
    while True:
        try:
            payload, ancillary, _, _ = end.recvmsg(2048, 64)
        except BlockingIOError:
            return found
        except ConnectionRefusedError:
            continue  # one end is not there (any more); the kernel says so at the next look
        [(_, _, stamp)] = ancillary
        seconds, nanoseconds = struct.unpack_from("qq", stamp)
        found.append((time.monotonic() - (time.time() - seconds - nanoseconds * 1e-9), payload))


def _send(end: socket.socket, payload: bytes, port: int | None) -> None:
    """One end that is not there does not matter."""
    with suppress(ConnectionRefusedError):
        end.sendto(payload, ("127.0.0.1", port))
