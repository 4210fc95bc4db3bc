"""Services of other vehicles on the same broker: which bodies they fly, and the ways that they have announced."""

import math
from dataclasses import dataclass

import aiomqtt
from pydantic import ValidationError

from companion.adapters.mqtt.rival import GONE_S, run_of
from companion.core.interfaces import Clock
from companion.protocol.intent import Intent
from companion.protocol.telemetry import Presence
from companion.protocol.topics import Topics, is_vehicle

_MOST = 32
"""Limit on remembered vehicles, as anybody may publish under any name."""


@dataclass
class _Neighbour:
    presence: Presence | None = None
    heard_s: float = -math.inf
    """Last sign of life, which services give twice a second."""
    intent: Intent | None = None


class Neighbours:
    """Listener to the other vehicles of one prefix; what the broker has kept of one that is gone counts for nothing."""

    def __init__(self, own: Presence, topics: Topics, clock: Clock) -> None:
        """`own` is the presence of this service, `topics` those of its vehicle."""
        self._own, self._clock = own, clock
        self._vehicle, every = topics.vehicle, Topics(topics.prefix, "+")
        self.topics = (every.status, every.intent)
        """Topics to subscribe to."""
        self._known: dict[str, _Neighbour] = {}

    def note(self, message: aiomqtt.Message) -> bool:
        """Take a status or an intent of another vehicle; return True when a service appears that flies our body."""
        levels = message.topic.value.split("/")
        if len(levels) != 4 or not isinstance(message.payload, bytes):
            return False
        name, kind = levels[2:]
        if name == self._vehicle or not is_vehicle(name):
            return False
        if name not in self._known and len(self._known) >= _MOST:
            return False
        known, before = self._known.setdefault(name, _Neighbour()), self.rival
        try:
            if kind == "intent":
                known.intent = Intent.model_validate_json(message.payload) if message.payload else None
            elif kind == "status":
                known.presence = Presence.model_validate_json(message.payload)
                known.heard_s = -math.inf if message.retain else self._clock.now_s()
        except ValidationError:
            return False
        return bool(self.rival) and not before

    def present(self) -> tuple[Presence, ...]:
        """Return the services of other vehicles that are heard now."""
        now_s = self._clock.now_s()
        heard = (one.presence for one in self._known.values() if now_s - one.heard_s < GONE_S)
        return tuple(presence for presence in heard if presence is not None and presence.online)

    def intents(self) -> tuple[Intent, ...]:
        """Return the ways announced by services that are heard now."""
        sessions = {presence.session for presence in self.present()}
        announced = (one.intent for one in self._known.values())
        return tuple(intent for intent in announced if intent is not None and intent.session in sessions)

    @property
    def rival(self) -> str:
        """Return an error with its remedy when another vehicle's service flies our body; empty otherwise."""
        for other in self.present():
            if self._own.body and other.body == self._own.body:
                return (
                    f"another service flies the same body in QTM, {other.body!r}: vehicle {other.vehicle!r}, "
                    f"{run_of(other)}: stop one of the two, or give each its own [mocap] body"
                )
        return ""
