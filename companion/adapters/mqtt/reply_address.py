"""Address to which the replies to one command are published."""

from dataclasses import dataclass, replace
from typing import Self

import aiomqtt
from pydantic import BaseModel

from companion.protocol.telemetry import Happened, Kind, Reply
from companion.protocol.topics import Topics

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
