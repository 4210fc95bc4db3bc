"""Where the answers to one command go."""

from dataclasses import dataclass, replace
from typing import Self

import aiomqtt
from pydantic import BaseModel

from companion.protocol.telemetry import Happened, Kind, Reply
from companion.protocol.topics import Topics

_MAX_CORRELATION_BYTES = 256
"""More is no number of anybody's, and would come back with every reply."""


@dataclass(frozen=True)
class ReplyAddress:
    """To one client's reply topic, or, when nobody is named, to everyone as an event."""

    topics: Topics
    topic: str
    correlation: bytes | None = None

    @classmethod
    def of(cls, message: aiomqtt.Message, topics: Topics) -> Self:
        """As MQTT 5's properties say; a response topic that is no reply topic of this vehicle is not used."""
        topic = getattr(message.properties, "ResponseTopic", None)
        correlation = getattr(message.properties, "CorrelationData", None)
        usable = isinstance(correlation, bytes) and len(correlation) <= _MAX_CORRELATION_BYTES
        goal = topic if isinstance(topic, str) and topics.is_reply(topic) else topics.event
        return cls(topics, goal, correlation if usable else None)

    def named(self, client: str | None) -> Self:
        """With `reply_to` of the command, which counts where no response topic does."""
        if client is None or self.topic != self.topics.event:
            return self
        return replace(self, topic=self.topics.reply(client))

    def message(self, reply: Reply) -> BaseModel:
        """The reply, or an event of it."""
        if self.topic != self.topics.event:
            return reply
        return Happened(time_s=reply.time_s, kind=Kind.REPLY, text=reply.text, name=reply.answer, id=reply.id)
