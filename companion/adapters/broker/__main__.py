"""The broker's own process: serves until standard input ends, and says on standard output that it lives."""

import asyncio
import logging
import os
import sys

from companion.adapters.broker.process import ALIVE, ALIVE_EVERY_S, READY
from companion.adapters.broker.server import EmbeddedBroker
from companion.adapters.system.realtime import beside_the_loop


async def serve(host: str, port: int) -> None:
    """Say that it is ready, or why it is not; then that it lives, until standard input ends."""
    broker = EmbeddedBroker(host, port)
    try:
        await broker.start()
    except Exception as error:
        os.write(1, f"{error}\n".encode())
        os._exit(1)
    os.write(1, READY)
    ended = asyncio.Event()
    asyncio.get_running_loop().add_reader(0, lambda: None if os.read(0, 64) else ended.set())
    while broker.broadcasts and not ended.is_set():
        os.write(1, ALIVE)
        try:
            async with asyncio.timeout(ALIVE_EVERY_S):
                await ended.wait()
        except TimeoutError:
            continue
    os._exit(0 if ended.is_set() else 1)  # there is nothing to keep, and amqtt's tasks complain when they are cancelled


if __name__ == "__main__":
    beside_the_loop()
    logging.getLogger("amqtt").setLevel(logging.CRITICAL)  # a client that dies is no news
    asyncio.run(serve(sys.argv[1], int(sys.argv[2])))
