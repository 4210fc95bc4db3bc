"""Queue to one page: of states only the newest waits; a page that does not keep up is given up."""

import asyncio
from collections import deque

_MOST = 1000
"""Messages other than states that may wait: 200 events are sent to a new page at once."""


class Outlet:
    """Messages that wait for one page."""

    def __init__(self) -> None:
        self._newest: dict[str, str] = {}
        self._queue: deque[str] = deque()
        self._there = asyncio.Event()
        self.overrun = False
        """True once more messages wait than may: the page has to begin again."""

    def put(self, frame: str) -> None:
        """Queue a message that must not be lost."""
        self.overrun = self.overrun or len(self._queue) >= _MOST
        if not self.overrun:
            self._queue.append(frame)
        self._there.set()

    def show(self, key: str, frame: str) -> None:
        """Replace the message with this key that still waits."""
        self._newest[key] = frame
        self._there.set()

    async def next(self) -> str:
        """Return the next message, in the order of `put`, then the newest states."""
        while not (self._queue or self._newest):
            self._there.clear()
            await self._there.wait()
        if self._queue:
            return self._queue.popleft()
        return self._newest.pop(next(iter(self._newest)))
