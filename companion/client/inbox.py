"""Messages of a connection for one reader among several."""

import asyncio
from collections import deque

from companion.client.messages import Message
from companion.protocol.telemetry import State

_MOST_STATES = 600
"""One minute of them. A reader that is further behind loses the oldest; nothing else is ever dropped."""


class Inbox:
    """Queue of one reader; a state is dropped when the reader is a minute behind."""

    def __init__(self) -> None:
        self._messages: deque[Message] = deque()
        self._states = 0
        self._arrived = asyncio.Event()

    def put(self, message: Message) -> None:
        """Add a message."""
        self._messages.append(message)
        self._arrived.set()
        if isinstance(message, State):
            self._states += 1
            if self._states > _MOST_STATES:
                self._messages.remove(next(one for one in self._messages if isinstance(one, State)))
                self._states -= 1

    async def next(self, timeout_s: float | None) -> Message | None:
        """Return the next message; None after the timeout."""
        try:
            async with asyncio.timeout(timeout_s):
                while not self._messages:
                    self._arrived.clear()
                    await self._arrived.wait()
        except TimeoutError:
            return None
        message = self._messages.popleft()
        self._states -= isinstance(message, State)
        return message
