"""Queue of messages to publish while the broker may be unreachable."""

import asyncio
import logging
from collections import deque
from dataclasses import dataclass

from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

LOG = logging.getLogger(__name__)

_TRIES = 3
"""Attempts for one message: one that breaks every connection must not block the others."""


@dataclass
class OutboxMessage:
    """One message at QoS 1."""

    topic: str
    payload: bytes
    correlation: bytes | None = None
    tries: int = 0

    def properties(self) -> Properties:
        """Return the PUBLISH properties for MQTT 5."""
        said = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
        if self.correlation is not None:
            said.CorrelationData = self.correlation
        return said


class Outbox:
    """First in, first out; of more than `most` the oldest is dropped. Waits in `next` and `empty` only."""

    def __init__(self, most: int) -> None:
        self._most, self._messages, self._there = most, deque[OutboxMessage](), asyncio.Event()
        self._open = 0
        self._all_said = asyncio.Event()
        self._all_said.set()

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: OutboxMessage) -> None:
        """Append a message; the oldest is dropped when the queue is full."""
        if len(self._messages) >= self._most:
            self._messages.popleft()
        self._messages.append(message)
        self._there.set()
        self._all_said.clear()

    async def next(self) -> OutboxMessage:
        """Wait for the oldest message and remove it; finish it with `said` or `not_said`."""
        while not self._messages:
            self._there.clear()
            await self._there.wait()
        self._open += 1
        return self._messages.popleft()

    def said(self) -> None:
        """Mark the message that was taken out as published."""
        self._open -= 1
        if not self._messages and not self._open:
            self._all_said.set()

    def not_said(self, message: OutboxMessage) -> None:
        """Put a message back in front, up to the limit of its tries."""
        message.tries += 1
        if message.tries < _TRIES and len(self._messages) < self._most:
            self._messages.appendleft(message)
            self._there.set()
        self.said()

    async def empty(self) -> None:
        """Wait until all is said."""
        await self._all_said.wait()
