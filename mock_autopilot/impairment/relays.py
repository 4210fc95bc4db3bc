"""Relays for pairs of ports, of either protocol."""

import contextlib
from collections.abc import AsyncIterator, Sequence

from mock_autopilot.impairment.ports import PortPair
from mock_autopilot.impairment.tcp_relay import TcpRelay, tcp_relay
from mock_autopilot.impairment.udp_relay import UdpRelay, udp_relay

Relay = UdpRelay | TcpRelay


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
