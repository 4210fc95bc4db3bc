"""Many open pages as a process: `python -m benchmarks.page_clients HOST:PORT COUNT`.

Reads words from standard input: "open" opens all pages and prints a line once each has heard a state; "close" closes
them and prints, as JSON, how many states each has heard meanwhile, and how many pages the server has closed.
"""

import asyncio
import json
import os
import sys
import time
from contextlib import suppress

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

_LOWEST = 19
_STATE = '{"type":"state"'


class Pages:
    """Open pages, and the states that each has heard."""

    def __init__(self, host: str, count: int) -> None:
        self._host, self._count = host, count
        self.states: list[int] = [0] * count
        self.lost, self.opened_s = 0, 0.0
        self._tasks: list[asyncio.Task[None]] = []
        self._heard = asyncio.Event()

    async def open(self) -> None:
        """Open all; return once each has heard a state."""
        self.states, self.lost = [0] * self._count, 0
        self._tasks = [asyncio.create_task(self._read(number), name="page") for number in range(self._count)]
        while not all(self.states):
            self._heard.clear()
            await self._heard.wait()
        self.states, self.opened_s = [0] * self._count, time.monotonic()

    async def close(self) -> None:
        """Close all."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _read(self, number: int) -> None:
        with suppress(ConnectionClosed):
            async with connect(f"ws://{self._host}/ws", origin=f"http://{self._host}", compression=None) as page:  # type: ignore[arg-type]
                async for text in page:
                    if isinstance(text, str) and text.startswith(_STATE):
                        self.states[number] += 1
                        self._heard.set()
        self.lost += 1
        self._heard.set()


async def main(host: str, count: int) -> None:
    """Open and close pages as standard input says."""
    pages, loop = Pages(host, count), asyncio.get_running_loop()
    while word := (await loop.run_in_executor(None, sys.stdin.readline)).strip():
        if word == "open":
            await pages.open()
            print("open", flush=True)
        else:
            said = {"states": pages.states, "lost": pages.lost, "for_s": time.monotonic() - pages.opened_s}
            text = json.dumps(said)
            await pages.close()
            print(text, flush=True)


if __name__ == "__main__":
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.setpriority(os.PRIO_PROCESS, 0, _LOWEST)
    asyncio.run(main(sys.argv[1], int(sys.argv[2])))
