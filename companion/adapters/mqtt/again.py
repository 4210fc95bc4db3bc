"""Connects to a broker again and again, with the version of MQTT that it speaks, and tells of it once."""

import asyncio
import logging
import ssl
from collections.abc import Awaitable, Callable

import aiomqtt
from aiomqtt.exceptions import MqttConnectError

from companion.adapters.mqtt.certificates import certificate_fault
from companion.adapters.mqtt.connection import V5, V311, UnansweredError, knows_no_mqtt5

LOG = logging.getLogger(__package__)

_FIRST_PAUSE_S = 0.2
_LONGEST_PAUSE_S = 2.0
_SPOKEN = {V5: "5", V311: "3.1.1"}


class Again:
    """For one broker. Whoever is connected calls `heard` as soon as, and whenever, the broker has answered."""

    def __init__(self, broker: str, version: aiomqtt.ProtocolVersion = V5) -> None:
        """`broker` as a sentence has it, `version` to try first."""
        self.version = version
        self.there = False
        """Whether it has answered in this connection."""
        self.why = ""
        """Why there is no connection; empty before the first attempt has failed, and while there is one."""
        self._broker = broker
        self._met = False

    async def keep(self, connected: Callable[[aiomqtt.ProtocolVersion], Awaitable[None]]) -> None:
        """Connect, again and again, until cancelled; `connected` is one connection, and raises what breaks it."""
        pause_s = _FIRST_PAUSE_S
        while True:
            try:
                await connected(self.version)
            except Exception as error:
                if self._tries_another(error):
                    continue
                self._tell_lost(error)
            pause_s = _FIRST_PAUSE_S if self.there else min(2.0 * pause_s, _LONGEST_PAUSE_S)
            self.there = False
            await asyncio.sleep(pause_s)

    def heard(self) -> None:
        """The broker is there."""
        if not self.there:
            LOG.info("%s is there, MQTT %s", self._broker, _SPOKEN[self.version])
            self.there, self._met, self.why = True, True, ""

    def _tries_another(self, error: BaseException) -> bool:
        """Whether to try an older version of MQTT at once; a broker that was met before is not tried with another."""
        if knows_no_mqtt5(error) or (isinstance(error, UnansweredError) and not self._met):
            self.version = V311 if self.version is V5 else V5
            return self.version is V311
        return False

    def _tell_lost(self, error: BaseException) -> None:
        """Once for every reason, not for every attempt."""
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        error = error.__cause__ or error
        plain = isinstance(error, aiomqtt.MqttCodeError) and not isinstance(error, MqttConnectError)
        why = "the connection broke" if plain else str(error) or type(error).__name__
        if isinstance(error, ssl.SSLError):
            why = certificate_fault(error)
        if why != self.why:
            LOG.warning("%s is not there: %s", self._broker, why)
            self.why = why
