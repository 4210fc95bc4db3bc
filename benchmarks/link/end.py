"""One end of the link, a process in a namespace of its own: `python -m benchmarks.link.end ROLE TRANSPORT FD`.

It sends the file descriptor of its packets over the socket FD, says "ready", and obeys lines on standard input: the
ground "send SECONDS", which it answers with the number of messages, both "end". The vehicle's last line is a JSON list
of [number, sent_s, arrived_s].
"""

import asyncio
import json
import os
import socket
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable

from benchmarks.link.message import PERIOD_S, pack, unpack
from benchmarks.link.namespace import GROUND, VEHICLE, NamespaceError, enter


def main() -> int:
    """Run until told to end."""
    role, transport, descriptor = sys.argv[1:]
    try:
        packets = enter(GROUND if role == "ground" else VEHICLE)
    except NamespaceError as error:
        print(f"no: {error}", flush=True)
        return 2
    with socket.socket(fileno=int(descriptor)) as relay:
        socket.send_fds(relay, [b"packets"], [packets])
    os.close(packets)
    asyncio.run((_ground if role == "ground" else _vehicle)(transport))
    return 0


async def _ground(transport: str) -> None:
    from benchmarks.link.transports import TRANSPORTS, quiet  # noqa: PLC0415  # threads only in the namespace

    quiet()
    async with TRANSPORTS[transport][0]() as send:
        async for words in _lines():
            if words[0] == "send":
                print(await _send_for(float(words[1]), send), flush=True)


async def _send_for(for_s: float, send: Callable[[bytes], Awaitable[None]]) -> int:
    """Send a message in each period; return their number."""
    begin_s, count = time.monotonic(), round(for_s / PERIOD_S)
    for number in range(count):
        await asyncio.sleep(max(begin_s + number * PERIOD_S - time.monotonic(), 0.0))
        await send(pack(number, time.monotonic()))
    return count


async def _vehicle(transport: str) -> None:
    from benchmarks.link.transports import TRANSPORTS, quiet  # noqa: PLC0415  # threads only in the namespace

    quiet()
    arrived: list[tuple[int, float, float]] = []

    def take(message: bytes) -> None:
        read = unpack(message)
        if read is not None:
            arrived.append((*read, time.monotonic()))

    async with TRANSPORTS[transport][1](take):
        async for _ in _lines():
            pass
    print(json.dumps(arrived), flush=True)


async def _lines() -> AsyncIterator[list[str]]:
    """Say that it is ready, and yield the words of each line until "end"."""
    reader, loop = asyncio.StreamReader(), asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    print("ready", flush=True)
    while (words := (await reader.readline()).decode().split()) and words[0] != "end":
        yield words


if __name__ == "__main__":
    sys.exit(main())
