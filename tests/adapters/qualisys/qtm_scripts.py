"""Servers that answer as told, with packets written by hand: what a real QTM may do and the mock server does not."""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import cast

ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT = 0, 1, 2, 3, 4, 6


def packet(kind: int, payload: bytes) -> bytes:
    return struct.pack("<II", 8 + len(payload), kind) + payload


def frame(number: int, stamp_us: int, bodies: list[list[float]]) -> bytes:
    """Return a data packet with 6dres; thirteen numbers a body."""
    body = struct.pack("<ihh", len(bodies), 0, 0) + b"".join(struct.pack("<13f", *values) for values in bodies)
    return packet(DATA, struct.pack("<qIIII", stamp_us, number, 1, 8 + len(body), 11) + body)


LEVEL_BODY = [1000.0, 2000.0, 3000.0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0.5]
WELCOME = packet(COMMAND, b"QTM RT Interface connected\0")
VERSION_SET = packet(COMMAND, b"Version set to 1.25\0")
ONE_BODY = packet(
    XML, b"<QTM_Parameters_Ver_1.25><The_6D><Body><Name>dauam</Name></Body></The_6D></QTM_Parameters_Ver_1.25>\0"
)
NO_BODIES = packet(XML, b"<QTM_Parameters_Ver_1.25><The_6D></The_6D></QTM_Parameters_Ver_1.25>\0")
GOOD: Mapping[str, bytes] = {
    "version": VERSION_SET,
    "getparameters": ONE_BODY,
    "streamframes": frame(1, 10_000, [LEVEL_BODY]) + frame(2, 20_000, [LEVEL_BODY]),
}
"""A conversation that goes well."""


class Scripted(asyncio.Protocol):
    """Says `welcome`, then answers every command by the first word; closes at a word it has no answer for."""

    def __init__(self, welcome: bytes, answers: Mapping[str, bytes]) -> None:
        self._welcome = welcome
        self._answers = answers
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        self._transport.write(self._welcome)

    def data_received(self, data: bytes) -> None:
        assert self._transport is not None
        while data and not self._transport.is_closing():
            size = int.from_bytes(data[:4], "little")
            word, data = data[8:size].split(b" ")[0].rstrip(b"\0").decode(), data[size:]
            if word not in self._answers:
                self._transport.close()
                return
            self._transport.write(self._answers[word])


class Silent(asyncio.Protocol):
    """Server that accepts connections and sends nothing."""


@asynccontextmanager
async def listening(make: Callable[[], asyncio.Protocol]) -> AsyncIterator[int]:
    """Serve on a free local port and yield its number."""
    transports: list[asyncio.BaseTransport] = []

    def remember() -> asyncio.Protocol:
        protocol = make()
        made = protocol.connection_made

        def connection_made(transport: asyncio.BaseTransport) -> None:
            transports.append(transport)
            made(transport)

        protocol.connection_made = connection_made  # type: ignore[method-assign]
        return protocol

    server = await asyncio.get_running_loop().create_server(remember, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for transport in transports:
            transport.close()
        await asyncio.sleep(0)


@asynccontextmanager
async def scripted(answers: Mapping[str, bytes], welcome: bytes = WELCOME) -> AsyncIterator[int]:
    """Run a `Scripted` server on a free port."""
    async with listening(lambda: Scripted(welcome, answers)) as port:
        yield port
