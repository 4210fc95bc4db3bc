"""The TCP relay over loopback, with real connections."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import pytest

from mock_autopilot.impairment import CUT, RelayError, TcpRelay, parse, tcp_relay

WAIT_S = 5.0


async def _echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Answer with the same bytes until the client's end, then end."""
    while data := await reader.read(4096):
        writer.write(data)
        await writer.drain()
    await closed(writer)


@asynccontextmanager
async def echo_server() -> AsyncIterator[int]:
    server = await asyncio.start_server(_echo, "127.0.0.1", 0)
    try:
        yield int(server.sockets[0].getsockname()[1])
    finally:
        server.close()


@asynccontextmanager
async def relayed(
    sentence: str, port: int
) -> AsyncIterator[tuple[TcpRelay, asyncio.StreamReader, asyncio.StreamWriter]]:
    async with tcp_relay(0, ("127.0.0.1", port), up=parse(sentence)) as relay:
        reader, writer = await asyncio.open_connection("127.0.0.1", relay.port)
        try:
            async with asyncio.timeout(WAIT_S):
                yield relay, reader, writer
        finally:
            await closed(writer)


async def closed(writer: asyncio.StreamWriter) -> None:
    writer.close()
    with suppress(OSError):
        await writer.wait_closed()


async def ended(reader: asyncio.StreamReader) -> bool:
    """Return whether the connection ends without another byte, in good order or reset."""
    with suppress(ConnectionResetError):
        return not await reader.read(1)
    return True


async def test_bytes_come_back_whole_and_the_end_of_the_stream_passes() -> None:
    sent = bytes(range(256)) * 2000
    async with echo_server() as port, relayed("jitter 2 ms", port) as (relay, reader, writer):
        writer.write(sent)
        writer.write_eof()
        assert await reader.read(-1) == sent
        assert relay.up_counts.arrived_bytes == relay.down_counts.arrived_bytes == len(sent)


async def test_loss_is_delay() -> None:
    async with echo_server() as port, relayed("off", port) as (relay, reader, writer):
        begin_s = asyncio.get_running_loop().time()
        writer.write(b"hello")
        while relay.up_counts.lost == 0:  # noqa: ASYNC110  # the counters tell nobody
            await asyncio.sleep(0.001)
        relay.set(up=parse("clean"))
        assert await reader.readexactly(5) == b"hello"
        assert asyncio.get_running_loop().time() - begin_s > 0.19, "the time-out for sending again"


async def test_two_connections_are_kept_apart() -> None:
    async with echo_server() as port, relayed("delay 1 ms", port) as (relay, reader, writer):
        other_reader, other_writer = await asyncio.open_connection("127.0.0.1", relay.port)
        writer.write(b"one")
        other_writer.write(b"two")
        assert await reader.readexactly(3) == b"one"
        assert await other_reader.readexactly(3) == b"two"
        await closed(other_writer)


async def test_a_server_that_is_not_there_cuts_the_client_off() -> None:
    async with echo_server() as port:
        pass
    async with relayed("clean", port) as (_, reader, _writer):
        assert await ended(reader)


async def test_the_end_of_the_relay_ends_its_connections() -> None:
    async with echo_server() as port:
        async with tcp_relay(0, ("127.0.0.1", port), up=CUT) as relay:
            reader, writer = await asyncio.open_connection("127.0.0.1", relay.port)
            writer.write(b"lost")
            while relay.up_counts.lost == 0:  # noqa: ASYNC110  # the counters tell nobody
                await asyncio.sleep(0.001)
        assert await asyncio.wait_for(ended(reader), WAIT_S)
        await closed(writer)


async def test_a_taken_port_is_named() -> None:
    async with echo_server() as port:
        with pytest.raises(RelayError, match=f"cannot listen on TCP 127.0.0.1:{port}"):
            async with tcp_relay(port, ("127.0.0.1", 9)):
                pass
