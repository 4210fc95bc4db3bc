"""One run: every transport at the same time, each over a wire of its own that is impaired in the same way."""

import asyncio
import contextlib
import json
import math
import socket
import sys
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

from benchmarks.link.message import BEAT_BYTES, EVENT_BYTES, PERIOD_S, pack, unpack
from benchmarks.link.namespace import NamespaceError
from benchmarks.link.summary import Arrival, Figures, ages_ms, held_ages_ms, percentile
from benchmarks.link.wire import Wire
from mock_autopilot.impairment import ImpairedStream, Impairment, parse

_READY_S = 40.0
_DRAIN_S = 5.0
"""For what is still on its way at the end, over a link that is perfect again."""
_OUTPUT_BYTES = 1 << 24
_TCP_HEADER_BYTES = 52
"""IPv4 and TCP with time stamps."""


class _End:
    """A process at one end."""

    def __init__(self, process: asyncio.subprocess.Process, packets: int) -> None:
        self._process, self.packets = process, packets

    async def line(self, within_s: float = _READY_S) -> str:
        """Return its next line."""
        assert self._process.stdout is not None
        return (await asyncio.wait_for(self._process.stdout.readline(), within_s)).decode().strip()

    async def ready(self) -> None:
        """Wait until it has connected, or listens."""
        said = await self.line()
        if said != "ready":
            raise RuntimeError(f"an end of the link has not started: {said or 'see above'}")

    def say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n".encode())


@asynccontextmanager
async def _end(role: str, transport: str) -> AsyncIterator[_End]:
    """Start one end; raise NamespaceError when it cannot have a namespace."""
    ours, theirs = socket.socketpair()
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "benchmarks.link.end", role, transport, str(theirs.fileno())),
        stdin=pipe,
        stdout=pipe,
        pass_fds=(theirs.fileno(),),
        limit=_OUTPUT_BYTES,
    )
    theirs.close()
    try:
        with ours:
            ours.settimeout(_READY_S)
            _, packets, _, _ = await asyncio.to_thread(socket.recv_fds, ours, 100, 1)
        if not packets:
            assert process.stdout is not None
            raise NamespaceError((await process.stdout.readline()).decode().strip().removeprefix("no: "))
        yield _End(process, packets[0])
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


@asynccontextmanager
async def _pair(transport: str, seed: int) -> AsyncIterator[tuple[_End, _End, Wire]]:
    """Start both ends and connect them over a perfect wire."""
    async with _end("vehicle", transport) as vehicle:
        await vehicle.ready()  # it listens
        async with _end("ground", transport) as ground:
            wire = Wire(ground.packets, vehicle.packets, seed)
            try:
                await ground.ready()
                yield ground, vehicle, wire
            finally:
                wire.close()


async def measure(link: str, transports: list[str], for_s: float, seed: int) -> list[Figures]:
    """Return the figures of all transports over a link, at the same time; raise NamespaceError where none is possible.

    They connect over a perfect link; only what is sent for `for_s` afterwards is impaired.
    """
    async with AsyncExitStack() as stack:
        pairs = await asyncio.gather(*(stack.enter_async_context(_pair(name, seed)) for name in transports))
        await asyncio.sleep(1.0)
        runs = (
            _run((name, link), pair, for_s, place * PERIOD_S / len(pairs))
            for place, (name, pair) in enumerate(zip(transports, pairs, strict=True))
        )
        return list(await asyncio.gather(*runs))


async def _run(names: tuple[str, str], pair: tuple[_End, _End, Wire], for_s: float, after_s: float) -> Figures:
    """Measure one transport; `after_s` keeps the transports from sending all in the same moment."""
    ground, vehicle, wire = pair
    transport, link = names
    await asyncio.sleep(after_s)
    before = wire.sent_bytes
    wire.set(parse(link))
    begin_s = time.monotonic()
    ground.say(f"send {for_s}")
    sent = int(await ground.line(for_s + _READY_S))
    end_s = time.monotonic()
    after = wire.sent_bytes
    wire.set(Impairment())
    await asyncio.sleep(_DRAIN_S)
    vehicle.say("end")
    arrivals: list[Arrival] = [tuple(one) for one in json.loads(await vehicle.line())]
    wire_bytes = after[0] - before[0], after[1] - before[1]
    return figures(transport, link, arrivals, sent, (begin_s, end_s), wire_bytes)


def model_tcp(link: str, for_s: float, seed: int) -> Figures:
    """Return the figures of TCP as the impairment tool's relay computes it, in simulated time; no bytes back."""
    up = ImpairedStream(parse(link), 2 * seed, seed)
    arrivals: list[Arrival] = []
    buffer = bytearray()

    def read_until(time_s: float) -> None:
        while up.next_s <= time_s and up.next_s < math.inf:
            now_s = up.next_s
            for data in up.due(now_s):
                buffer.extend(data)
            while buffer and len(buffer) > buffer[0]:
                number, sent_s = unpack(bytes(buffer[1 : 1 + buffer[0]])) or (0, 0.0)
                arrivals.append((number, sent_s, now_s))
                del buffer[: 1 + buffer[0]]

    sent = round(for_s / PERIOD_S)
    for number in range(sent):
        read_until(number * PERIOD_S)
        message = pack(number, number * PERIOD_S)
        up.put(number * PERIOD_S, bytes([len(message)]) + message)
    up_bytes = up.counts.sent_bytes + _TCP_HEADER_BYTES * up.counts.sent
    read_until(for_s)
    up.set(Impairment())
    read_until(for_s + _DRAIN_S)
    return figures("TCP, the relay's model", link, arrivals, sent, (0.0, for_s), (up_bytes, 0))


def figures(
    transport: str,
    link: str,
    arrivals: list[Arrival],
    sent: int,
    span_s: tuple[float, float],
    wire_bytes: tuple[int, int],
) -> Figures:
    """Return the figures of one run."""
    begin_s, end_s = span_s
    ages = ages_ms(arrivals)
    held = held_ages_ms(arrivals, begin_s + 1.0, end_s)
    for_s = end_s - begin_s
    return Figures(
        link=link,
        transport=transport,
        sent=sent,
        lost=sent - len(ages),
        age_median_ms=percentile(ages, 0.5),
        age_p99_ms=percentile(ages, 0.99),
        age_longest_ms=percentile(ages, 1.0),
        held_median_ms=percentile(held, 0.5),
        held_p99_ms=percentile(held, 0.99),
        held_longest_ms=percentile(held, 1.0),
        payload_bytes_per_s=(EVENT_BYTES + 2 * BEAT_BYTES) / 3 / PERIOD_S,
        wire_up_bytes_per_s=wire_bytes[0] / for_s,
        wire_down_bytes_per_s=wire_bytes[1] / for_s,
    )
