"""A TCP port that passes connections on to another one over an impaired link."""

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Iterator

from mock_autopilot.impairment.delivery import TimedDelivery
from mock_autopilot.impairment.direction import Counts
from mock_autopilot.impairment.model import CLEAN, Impairment
from mock_autopilot.impairment.ports import Address
from mock_autopilot.impairment.stream import ImpairedStream
from mock_autopilot.impairment.udp_relay import RelayError

MOST_WAITING_BYTES = 65_536
"""With so many bytes on their way nothing more is read, as with a full send buffer: the writer has to wait."""
CHUNK_BYTES = 16_384


class TcpRelay:
    """A running relay: see `tcp_relay`."""

    def __init__(self, to: Address, up: Impairment, down: Impairment, seed: int) -> None:
        self._to, self._up, self._down, self._seed = to, up, down, seed
        self._server: asyncio.Server | None = None
        self._pipes: set[_Pipe] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._number, self._begin_s = 0, time.monotonic()
        self.up_counts = Counts()
        """Segments from the clients to the server."""
        self.down_counts = Counts()
        """Segments from the server to the clients."""

    @property
    def port(self) -> int:
        """Return the TCP port that it listens on."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    def set(self, up: Impairment | None = None, down: Impairment | None = None) -> None:
        """Change the impairment of the directions that are given, from the next segment on."""
        self._up, self._down = up or self._up, down or self._down
        for pipe in self._pipes:
            pipe.set(*((self._up, self._down) if pipe.upward else (self._down, self._up)))

    async def open(self, host: str, port: int) -> None:
        """Listen; raise RelayError when the address is taken."""
        try:
            self._server = await asyncio.start_server(self._accept, host, port)
        except OSError as error:
            raise RelayError(
                f"cannot listen on TCP {host}:{port} ({error.strerror}): stop the other program on that port or choose "
                "another"
            ) from error

    async def close(self) -> None:
        """Close every connection; what is on its way is lost."""
        if self._server is not None:
            self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.sleep(0)  # lets the transports see their end

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            with contextlib.suppress(OSError), _closed(writer):  # a server that is not there: the client is cut off
                server_reader, server_writer = await asyncio.open_connection(*self._to)
                with _closed(server_writer):
                    await self._pass_on((reader, server_writer), (server_reader, writer))
        finally:
            self._tasks.discard(task)

    async def _pass_on(self, upward: "_Ends", downward: "_Ends") -> None:
        """Pass on both directions until both have ended, or one breaks."""
        seed, self._number = self._seed + 2 * self._number, self._number + 1
        pipes = [
            self._pipe(upward, ImpairedStream(self._up, seed, self._seed), upward=True),
            self._pipe(downward, ImpairedStream(self._down, seed + 1, self._seed), upward=False),
        ]
        self._pipes.update(pipes)
        self.set()
        try:
            async with asyncio.TaskGroup() as tasks:
                for pipe in pipes:
                    tasks.create_task(pipe.run(), name="mock_autopilot.impairment.pipe")
        except* OSError as errors:  # one end has reset its connection: the other one is cut off, too
            raise ConnectionResetError from errors
        finally:
            self._pipes.difference_update(pipes)

    def _pipe(self, ends: "_Ends", stream: ImpairedStream, upward: bool) -> "_Pipe":
        stream.counts = self.up_counts if upward else self.down_counts  # one sum of all connections
        return _Pipe(ends, stream, self._begin_s, upward)


_Ends = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class _Pipe:
    """One direction of a connection, from a reader to a writer."""

    def __init__(self, ends: _Ends, stream: ImpairedStream, begin_s: float, upward: bool) -> None:
        self._reader, self._writer = ends
        self._stream, self.upward = stream, upward
        self._delivery = TimedDelivery(stream, self._write, begin_s)
        self._moved = asyncio.Event()

    def set(self, impairment: Impairment, back: Impairment) -> None:
        """Change the impairment, and that of the acknowledgements."""
        self._stream.set(impairment, back)
        self._delivery.look()

    async def run(self) -> None:
        """Pass on until the end of the stream, and the end as well."""
        try:
            while data := await self._reader.read(CHUNK_BYTES):
                self._stream.put(self._delivery.now_s, data)
                self._delivery.look()
                await self._wait_for_room(MOST_WAITING_BYTES)
            await self._wait_for_room(0)
            self._writer.write_eof()
        finally:
            self._delivery.close()

    def _write(self, data: bytes) -> None:
        self._writer.write(data)
        self._moved.set()

    async def _wait_for_room(self, at_most_bytes: int) -> None:
        """Wait until no more than `at_most_bytes` are on their way, and the reader of this end has kept up."""
        while self._stream.waiting_bytes > at_most_bytes:
            self._moved.clear()
            await self._moved.wait()
        await self._writer.drain()


@contextlib.contextmanager
def _closed(writer: asyncio.StreamWriter) -> Iterator[None]:
    """Close the connection in the end; after an error whatever is still to be written is lost."""
    try:
        yield
    except BaseException:
        writer.transport.abort()
        raise
    writer.close()


@contextlib.asynccontextmanager
async def tcp_relay(
    listen_port: int,
    to: Address,
    *,
    up: Impairment = CLEAN,
    down: Impairment = CLEAN,
    seed: int = 1,
    listen_host: str = "127.0.0.1",
) -> AsyncIterator[TcpRelay]:
    """Listen on a TCP port (0: any free one) and pass connections on to `to`, over the impaired link.

    TCP loses nothing: loss becomes the delay of sending again (`stream`); reordering is left out. Bursts cut
    all connections at the same times; a rate is each connection's own. Connecting itself is not impaired. Raises
    RelayError.
    """
    relay = TcpRelay(to, up, down, seed)
    await relay.open(listen_host, listen_port)
    try:
        yield relay
    finally:
        await relay.close()
