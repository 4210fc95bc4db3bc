"""A pair of ports with an impaired link between them: what the console and the mock's configuration name."""

import contextlib
import re
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

from mock_autopilot.impairment.sentences import Directions
from mock_autopilot.impairment.tcp_relay import TcpRelay, tcp_relay
from mock_autopilot.impairment.udp_relay import Address, UdpRelay, udp_relay

Protocol = Literal["udp", "tcp"]
Relay = UdpRelay | TcpRelay
_ADDRESS = re.compile(r"(?:(?P<host>[^\s:\[\]]+|\[[0-9a-fA-F:.]+\]):)?(?P<port>\d{1,5})")


@dataclass(frozen=True)
class PortPair:
    """A port that passes everything on to another one."""

    protocol: Protocol
    listen: Address
    to: Address
    link: Directions = field(default_factory=Directions)

    def __str__(self) -> str:
        (here, port), (host, to) = self.listen, self.to
        return f"{self.protocol} {here}:{port} -> {host}:{to}"


def address(text: str) -> Address:
    """Return "HOST:PORT" or "PORT" (of this machine) as host and port; raise ValueError with one sentence."""
    match = _ADDRESS.fullmatch(text.strip())
    if match is None or int(match["port"]) > 65535:
        raise ValueError(f'"{text}" is no address: write HOST:PORT, or PORT alone for this machine')
    return (match["host"] or "127.0.0.1").strip("[]"), int(match["port"])


@contextlib.asynccontextmanager
async def open_relays(pairs: Sequence[PortPair], seed: int) -> AsyncIterator[list[Relay]]:
    """Open a relay for each pair; raise RelayError when one cannot listen."""
    async with contextlib.AsyncExitStack() as stack:
        relays: list[Relay] = []
        for number, pair in enumerate(pairs):
            relay_of = udp_relay if pair.protocol == "udp" else tcp_relay
            host, port = pair.listen
            link = pair.link
            relays.append(
                await stack.enter_async_context(
                    relay_of(port, pair.to, up=link.up, down=link.down, seed=seed + number, listen_host=host)
                )
            )
        yield relays
