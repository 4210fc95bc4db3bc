"""A UDP port that passes datagrams on to another one over an impaired link, for any number of clients."""

import asyncio
import contextlib
import socket
import time
from collections.abc import AsyncIterator
from typing import Any

from mock_autopilot.impairment.delivery import TimedDelivery
from mock_autopilot.impairment.direction import Counts, ImpairedDirection
from mock_autopilot.impairment.model import CLEAN, Impairment
from mock_autopilot.impairment.ports import Address

_Raw = Any  # an address as the socket module has it: of two or four values
MAX_DATAGRAM = 65_536
BUFFER_BYTES = 1 << 20
FORGOTTEN_AFTER_S = 60.0
"""A client that was silent so long, and got nothing, is forgotten; its next datagram comes from another port."""


class RelayError(OSError):
    """The relay cannot use an address; the message is one sentence for a person."""


class UdpRelay:
    """A running relay: see `udp_relay`."""

    def __init__(self, inward: socket.socket, to: _Raw, up: Impairment, down: Impairment, seed: int) -> None:
        self._inward, self._to = inward, to
        self._clients: dict[_Raw, _Client] = {}
        self.up: ImpairedDirection[tuple[_Client, bytes]] = ImpairedDirection(up, 2 * seed, seed)
        """From the clients to the server."""
        self.down: ImpairedDirection[tuple[_Client, bytes]] = ImpairedDirection(down, 2 * seed + 1, seed)
        """From the server to the clients."""
        begin_s = time.monotonic()
        self._upward = TimedDelivery(self.up, lambda sent: _send(sent[0].outward, sent[1], None), begin_s)
        self._downward = TimedDelivery(self.down, lambda sent: _send(inward, sent[1], sent[0].address), begin_s)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(inward, self._take_upward)

    @property
    def up_counts(self) -> Counts:
        """Return what passed and what was lost from the clients to the server."""
        return self.up.counts

    @property
    def down_counts(self) -> Counts:
        """Return what passed and what was lost from the server to the clients."""
        return self.down.counts

    @property
    def port(self) -> int:
        """Return the UDP port that it listens on."""
        return int(self._inward.getsockname()[1])

    def set(self, up: Impairment | None = None, down: Impairment | None = None) -> None:
        """Change the impairment of the directions that are given, from the next datagram on."""
        if up is not None:
            self._upward.set(up)
        if down is not None:
            self._downward.set(down)

    def close(self) -> None:
        """Close every socket; what is on its way is lost."""
        self._upward.close()
        self._downward.close()
        for end in (self._inward, *(client.outward for client in self._clients.values())):
            self._loop.remove_reader(end)
            end.close()
        self._clients = {}

    def _take_upward(self) -> None:
        now_s = self._upward.now_s
        for payload, sender in _waiting(self._inward):
            client = self._clients.get(sender) or self._welcome(sender, now_s)
            client.heard_s = now_s
            self.up.put(now_s, (client, payload), len(payload))
        self._upward.look()

    def _welcome(self, address: _Raw, now_s: float) -> "_Client":
        """Return a new client with a socket of its own towards the server, and forget those that have gone."""
        for old in [one for one in self._clients.values() if now_s - one.heard_s > FORGOTTEN_AFTER_S]:
            self._loop.remove_reader(old.outward)
            old.outward.close()
            del self._clients[old.address]
        outward = _datagram_socket(self._inward.family)
        outward.connect(self._to)
        client = self._clients[address] = _Client(address, outward)
        self._loop.add_reader(outward, self._take_downward, client)
        return client

    def _take_downward(self, client: "_Client") -> None:
        client.heard_s = now_s = self._downward.now_s
        for payload, _ in _waiting(client.outward):
            self.down.put(now_s, (client, payload), len(payload))
        self._downward.look()


class _Client:
    """One client, and the socket through which its datagrams reach the server."""

    def __init__(self, address: _Raw, outward: socket.socket) -> None:
        self.address, self.outward, self.heard_s = address, outward, 0.0


@contextlib.asynccontextmanager
async def udp_relay(
    listen_port: int,
    to: Address,
    *,
    up: Impairment = CLEAN,
    down: Impairment = CLEAN,
    seed: int = 1,
    listen_host: str = "127.0.0.1",
) -> AsyncIterator[UdpRelay]:
    """Listen on a UDP port (0: any free one) and pass everything on to `to` and back, over the impaired link.

    Each client's datagrams reach the server from a port of their own, so the server can answer each. The clients share
    the link, its rate and its bursts. Arrivals are exact to the event loop's timers, about 1 ms. Raises RelayError.
    """
    family, server = await _resolved(to)
    _, here = await _resolved((listen_host, listen_port), family)
    inward = _datagram_socket(family)
    try:
        inward.bind(here)
    except OSError as error:
        inward.close()
        raise RelayError(
            f"cannot listen on UDP {listen_host}:{listen_port} ({error.strerror}): stop the other program on that port "
            "or choose another"
        ) from error
    relay = UdpRelay(inward, server, up, down, seed)
    try:
        yield relay
    finally:
        relay.close()


async def _resolved(address: Address, family: int = socket.AF_UNSPEC) -> tuple[int, _Raw]:
    """Return family and raw address of a host's port."""
    loop = asyncio.get_running_loop()
    try:
        found = await loop.getaddrinfo(*address, family=family, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise RelayError(f"{address[0]} is no known host ({error.strerror})") from error
    return found[0][0], found[0][4]


def _datagram_socket(family: int) -> socket.socket:
    end = socket.socket(family, socket.SOCK_DGRAM)
    end.setblocking(False)
    for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
        end.setsockopt(socket.SOL_SOCKET, option, BUFFER_BYTES)
    return end


def _waiting(end: socket.socket) -> list[tuple[bytes, _Raw]]:
    """Return all waiting datagrams with their senders."""
    found: list[tuple[bytes, _Raw]] = []
    while True:
        try:
            found.append(end.recvfrom(MAX_DATAGRAM))
        except BlockingIOError:
            return found
        except OSError:
            continue  # "connection refused" of a server that is not there (yet): the datagram is lost


def _send(end: socket.socket, payload: bytes, to: _Raw | None) -> None:
    """Send one datagram; to nobody, or into a full buffer, it is lost, as on any network."""
    with contextlib.suppress(OSError):
        if to is None:
            end.send(payload)
        else:
            end.sendto(payload, to)
