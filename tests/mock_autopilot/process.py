"""The mock as a user starts it: its own process, on free ports."""

import contextlib
import signal
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from tests.warm import Piped


def free_udp_port() -> int:
    """Return a UDP port that is free at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@dataclass(frozen=True)
class Mock:
    """A running mock: where it sends, where it listens."""

    process: Piped
    client_port: int
    own_port: int


def start(*arguments: str) -> Piped:
    """`python -m mock_autopilot`, ending with our end of its standard input."""
    return Piped("mock_autopilot", "--exit-with-stdin", *arguments)


@contextlib.contextmanager
def running(*arguments: str) -> Iterator[Mock]:
    """Started and ready; ended and reaped afterwards."""
    client_port = free_udp_port()
    process = start("--port", str(client_port), "--listen", "0", "--no-qualisys", *arguments)
    try:
        ready = process.stdout.readline()
        assert ready.startswith("mock autopilot ready: MAVLink udp "), ready
        yield Mock(process, client_port, int(ready.split()[5]))
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=10.0)


class Client:
    """A bare MAVLink client on a UDP port."""

    def __init__(self, mock: Mock, port: int | None = None, system: int = 245) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", mock.client_port if port is None else port))
        self.socket.settimeout(5.0)
        self.codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self._mock = mock

    def send(self, message: Any) -> None:
        frame = message.pack(self.codec)
        self.socket.sendto(bytes(frame), ("127.0.0.1", self._mock.own_port))

    def receive(self) -> list[Any]:
        """The messages of one datagram."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        return list(parser.parse_buffer(self.socket.recv(2048)) or [])

    def wait_for(self, type_: str, at_most: int = 3000) -> Any:
        """Return the next message of that type, from a limited number of messages."""
        for _ in range(at_most):
            for message in self.receive():
                if message.get_type() == type_:
                    return message
        raise AssertionError(f"no {type_} among {at_most} messages")

    def close(self) -> None:
        self.socket.close()
