"""Both ends of the law's link over UDP: datagrams in, datagrams out; what they mean is in `companion.law_link`."""

import asyncio
import errno
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from companion import __version__
from companion.config.companion_config import CompanionConfig, agreed_of
from companion.core.interfaces import Clock, ConfigError
from companion.law_link.agreement import Introduction
from companion.law_link.ground_end import GroundEnd
from companion.law_link.vehicle_end import VehicleEnd

LOG = logging.getLogger(__name__)

Address = tuple[str | Any, int]
_LARGEST_BYTES = 1400
"""Payload that no usual network splits."""


class _Datagrams(asyncio.DatagramProtocol):
    """Socket's events, passed to functions."""

    def __init__(
        self, hear: Callable[[bytes, Address], None], complain: Callable[[Exception], None] = lambda _: None
    ) -> None:
        self._hear, self._complain = hear, complain

    def datagram_received(self, data: bytes, addr: Address) -> None:
        """Pass on one datagram."""
        self._hear(data, addr)

    def error_received(self, exc: Exception) -> None:
        """Pass on what the network says, such as a port where nobody listens; silence is judged elsewhere."""
        LOG.debug("the law's link: %s", exc)
        self._complain(exc)


class VehicleLink:
    """Vehicle's socket: `flight.remote_step.LawLink`. Made by `open_vehicle_link`."""

    def __init__(self, end: VehicleEnd, clock: Clock) -> None:
        self.end = end
        self._clock = clock
        self._transport: asyncio.DatagramTransport | None = None
        self._ground: Address | None = None

    def send(self, datagram: bytes) -> None:
        """Send to where the session's newest message came from."""
        if self._transport is not None and self._ground is not None and len(datagram) <= _LARGEST_BYTES:
            self._transport.sendto(datagram, self._ground)

    def hear(self, data: bytes, addr: Address) -> None:
        """Take one datagram; follow the session to the address of its newest message."""
        before = self.end.received
        reply = self.end.hear(data, self._clock.now_s(), f"{addr[0]}:{addr[1]}")
        if self.end.received != before:
            self._ground = addr
        if reply is not None and self._transport is not None:
            self._transport.sendto(reply, addr)

    def opened(self, transport: asyncio.DatagramTransport) -> None:
        """Use this socket."""
        self._transport = transport


def introduction(config: CompanionConfig, law: str) -> Introduction:
    """Return this process as it introduces itself on the link."""
    host = f"{socket.gethostname()} (process {os.getpid()})"
    return Introduction(version=__version__, law=law, host=host, agreed=agreed_of(config))


@asynccontextmanager
async def open_law_link(config: CompanionConfig, clock: Clock) -> AsyncIterator[VehicleLink]:
    """Listen for a ground law; ConfigError for a key or port that cannot be used."""
    settings = config.law.link
    link = VehicleLink(VehicleEnd(settings.secret(), introduction(config, ""), os.urandom), clock)
    try:
        bound = _bound(settings.listen, settings.port)
    except OSError as error:
        raise ConfigError(_why_not_bound(settings.listen, settings.port, error)) from error
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(lambda: _Datagrams(link.hear), sock=bound)
    link.opened(transport)
    try:
        yield link
    finally:
        transport.close()


def _bound(listen: str, port: int) -> socket.socket:
    """Return a socket at this address; uvloop would hide the reason of a failure. Raises OSError."""
    family, kind, protocol, _, address = socket.getaddrinfo(listen, port, type=socket.SOCK_DGRAM)[0]
    bound = socket.socket(family, kind, protocol)
    try:
        bound.setblocking(False)
        bound.bind(address)
    except OSError:
        bound.close()
        raise
    return bound


def _why_not_bound(listen: str, port: int, error: OSError) -> str:
    """Return why there is no socket, and what to do."""
    port_todo = {
        errno.EADDRINUSE: "does another vehicle's service have it? Each needs a port of its own",
        errno.EACCES: "take a port above 1023",
    }
    todo = port_todo.get(error.errno or 0)
    if todo:
        return f"law.link.port = {port}: cannot listen on {listen}: {error.strerror}; {todo}"
    return f"law.link.listen = {listen!r}: {error.strerror or error}; give an address of this computer, or 0.0.0.0"


class GroundLink:
    """Ground's socket. Made by `open_ground_link`."""

    def __init__(self, end: GroundEnd, clock: Clock) -> None:
        self.end = end
        self._clock = clock
        self._transport: asyncio.DatagramTransport | None = None
        self.trouble = ""
        """What the network says of the vehicle's address, such as "connection refused"; empty once it was heard."""

    def complain(self, error: Exception) -> None:
        """Note an error of the network."""
        refused = isinstance(error, ConnectionRefusedError)
        self.trouble = "nobody listens there" if refused else str(error)

    def hear(self, data: bytes, _: Address) -> None:
        """Take one datagram of the vehicle."""
        self.trouble = ""
        self.end.hear(data, self._clock.now_s())

    def send_due(self) -> None:
        """Send what is due now; once a cycle."""
        for datagram in self.end.tick(self._clock.now_s()):
            if self._transport is not None:
                self._transport.sendto(datagram)

    def opened(self, transport: asyncio.DatagramTransport) -> None:
        """Use this socket."""
        self._transport = transport


@asynccontextmanager
async def open_ground_link(config: CompanionConfig, law: str, clock: Clock) -> AsyncIterator[GroundLink]:
    """Connect a socket to the vehicle's address; ConfigError for a key or address that cannot be used."""
    settings = config.law.link
    link = GroundLink(GroundEnd(settings.secret(), introduction(config, law), os.urandom, settings.beat_s), clock)
    try:
        transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
            lambda: _Datagrams(link.hear, link.complain), remote_addr=(settings.host, settings.port)
        )
    except OSError as error:
        raise ConfigError(
            f"law.link.host = {settings.host!r}: cannot be reached: {error.strerror or error}; give the vehicle's "
            "address or name"
        ) from error
    link.opened(transport)
    try:
        yield link
    finally:
        transport.close()
