"""Another service that speaks under the same vehicle's name on the same broker."""

import time

import aiomqtt
from pydantic import ValidationError

from companion.core.interfaces import Clock
from companion.protocol.telemetry import Presence

LISTEN_S = 1.2
"""Another service is heard more than once within this: it says twice a second that it is there."""
GONE_S = 3.0
"""Silence after which the other service counts as ended."""


class Rival:
    """Detector of a second service with the same vehicle name, by its presence on the status topic."""

    def __init__(self, own: Presence, topic: str, where: str, clock: Clock) -> None:
        """`topic` is the status topic, `where` the broker, for a sentence."""
        self._own, self._topic, self._where, self._clock = own, topic, where, clock
        self._presence: Presence | None = None
        self._heard_s = float("-inf")
        self.echoed = False
        """We were heard ourselves: the broker lets us read what a service says of itself."""

    def note(self, message: aiomqtt.Message) -> bool:
        """Process a status message; return True for a service not heard before. Retained ones are ignored."""
        if message.retain or not isinstance(message.payload, bytes):
            return False
        try:
            said = Presence.model_validate_json(message.payload)
        except ValidationError:
            return False
        self.echoed = self.echoed or said.session == self._own.session
        if not said.online or said.session in {"", self._own.session}:
            return False
        new = not self.sentence or self._presence is None or self._presence.session != said.session
        self._presence, self._heard_s = said, self._clock.now_s()
        return new

    @property
    def sentence(self) -> str:
        """Return an error with its remedy; empty when no other service is seen."""
        other = self._presence
        if other is None or self._clock.now_s() - self._heard_s > GONE_S:
            return ""
        return (
            f"another service has this vehicle's name ({self._topic.removesuffix('/status')} at {self._where}): "
            f"{run_of(other)}: stop one of the two, or give this one another [operator] vehicle"
        )


def run_of(presence: Presence) -> str:
    """Return where a service runs and since when, as part of a sentence."""
    since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(presence.since_s))
    host = presence.host or "a computer that does not say its name"
    return f"on {host}, version {presence.version or 'unknown'}, since {since}"
