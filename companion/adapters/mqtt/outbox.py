"""Messages to publish: where a reply goes, and the queue of what waits while the broker is unreachable."""

import asyncio
import logging
from collections import deque
from dataclasses import dataclass, replace
from typing import Self

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from pydantic import BaseModel

from companion.protocol.telemetry import Happened, Kind, Reply
from companion.protocol.topics import Topics

LOG = logging.getLogger(__name__)

_TRIES = 3
"""Attempts for one message: one that breaks every connection must not block the others."""


_MAX_CORRELATION_BYTES = 256
"""Longest correlation data that is sent back with replies."""


@dataclass(frozen=True)
class ReplyAddress:
    """Reply topic of one client; the event topic when the command names no client."""

    topics: Topics
    topic: str
    correlation: bytes | None = None

    @classmethod
    def of(cls, message: aiomqtt.Message, topics: Topics) -> Self:
        """Return the address in MQTT 5's properties; only a reply topic of this vehicle is accepted."""
        topic = getattr(message.properties, "ResponseTopic", None)
        correlation = getattr(message.properties, "CorrelationData", None)
        usable = isinstance(correlation, bytes) and len(correlation) <= _MAX_CORRELATION_BYTES
        goal = topic if isinstance(topic, str) and topics.is_reply(topic) else topics.event
        return cls(topics, goal, correlation if usable else None)

    def named(self, client: str | None) -> Self:
        """Return the address with the command's `reply_to`, used when there is no response topic."""
        if client is None or self.topic != self.topics.event:
            return self
        return replace(self, topic=self.topics.reply(client))

    def message(self, reply: Reply) -> BaseModel:
        """Return the reply itself, or an event of it when it goes to the event topic."""
        if self.topic != self.topics.event:
            return reply
        return Happened(time_s=reply.time_s, kind=Kind.REPLY, text=reply.text, name=reply.answer, id=reply.id)


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
        self._all_published = asyncio.Event()
        self._all_published.set()

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, message: OutboxMessage) -> None:
        """Append a message; the oldest is dropped when the queue is full."""
        if len(self._messages) >= self._most:
            self._messages.popleft()
        self._messages.append(message)
        self._there.set()
        self._all_published.clear()

    async def next(self) -> OutboxMessage:
        """Wait for the oldest message and remove it; finish it with `published` or `not_published`."""
        while not self._messages:
            self._there.clear()
            await self._there.wait()
        self._open += 1
        return self._messages.popleft()

    def published(self) -> None:
        """Mark the message that was taken out as published."""
        self._open -= 1
        if not self._messages and not self._open:
            self._all_published.set()

    def not_published(self, message: OutboxMessage) -> None:
        """Put a message back in front, up to the limit of its tries."""
        message.tries += 1
        if message.tries < _TRIES and len(self._messages) < self._most:
            self._messages.appendleft(message)
            self._there.set()
        self.published()

    async def empty(self) -> None:
        """Wait until all messages are published."""
        await self._all_published.wait()
