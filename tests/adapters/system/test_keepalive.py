"""The kernel asks the far side of a TCP connection whether it is still there."""

import asyncio
import socket
from collections.abc import Callable

import pytest
import uvloop

from companion.adapters.system.keepalive import keep_alive


async def _options() -> tuple[int, int]:
    """Return whether a connection is kept alive, and its timeout for unacknowledged data, ms."""
    loop = asyncio.get_running_loop()
    server = await loop.create_server(asyncio.Protocol, "127.0.0.1", 0)
    transport, _ = await loop.create_connection(asyncio.Protocol, *server.sockets[0].getsockname())
    keep_alive(transport)
    sock = transport.get_extra_info("socket")
    options = (socket.SOL_SOCKET, socket.SO_KEEPALIVE), (socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
    alive, unanswered_ms = (sock.getsockopt(*option) for option in options)
    transport.abort()
    server.close()
    await asyncio.sleep(0)
    return alive, unanswered_ms


@pytest.mark.parametrize("new_loop", [asyncio.new_event_loop, uvloop.new_event_loop])
def test_a_connection_whose_far_side_is_gone_ends_within_seconds(
    new_loop: Callable[[], asyncio.AbstractEventLoop],
) -> None:
    with asyncio.Runner(loop_factory=new_loop) as runner:
        assert runner.run(_options()) == (1, 5000)


def test_a_transport_without_a_tcp_socket_is_left_as_it_is() -> None:
    keep_alive(asyncio.BaseTransport())
