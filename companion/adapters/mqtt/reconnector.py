"""Connects to a broker again and again, with the version of MQTT that it speaks."""

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


class Reconnector:
    """For one broker. Whoever is connected calls `heard` as soon as, and whenever, the broker has answered."""

    def __init__(self, version: aiomqtt.ProtocolVersion, on_lost: Callable[[Exception], None]) -> None:
        """`version` is tried first; `on_lost` is told why a connection failed or broke: what it raises ends `keep`."""
        self.version = version
        self.there = False
        """Whether it has answered in this connection."""
        self._on_lost = on_lost
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
                self._on_lost(error)
            pause_s = _FIRST_PAUSE_S if self.there else min(2.0 * pause_s, _LONGEST_PAUSE_S)
            self.there = False
            await asyncio.sleep(pause_s)

    def heard(self) -> None:
        """Note that the broker is there."""
        self.there = self._met = True

    def _tries_another(self, error: BaseException) -> bool:
        """Return whether to try an older version of MQTT at once; a broker that was met keeps its version."""
        if knows_no_mqtt5(error) or (isinstance(error, UnansweredError) and not self._met):
            self.version = V311 if self.version is V5 else V5
            return self.version is V311
        return False


class LoggedReconnector(Reconnector):
    """One that logs once that the broker is there, and each reason once why it is not."""

    def __init__(self, broker: str, version: aiomqtt.ProtocolVersion = V5) -> None:
        """`broker` as a sentence has it, `version` to try first."""
        super().__init__(version, self._tell_lost)
        self.why = ""
        """Why there is no connection; empty before the first attempt has failed, and while there is one."""
        self._broker = broker

    def heard(self) -> None:
        """Note that the broker is there, and say so when it was not."""
        if not self.there:
            LOG.info("%s is there, MQTT %s", self._broker, _SPOKEN[self.version])
            self.why = ""
        super().heard()

    def _tell_lost(self, error: Exception) -> None:
        why = reason_of(error)
        if why != self.why:
            LOG.warning("%s is not there: %s", self._broker, why)
            self.why = why


def reason_of(error: BaseException) -> str:
    """Return why a connection failed or broke, as a part of a sentence."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    error = error.__cause__ or error
    if isinstance(error, ssl.SSLError):
        return certificate_fault(error)
    if isinstance(error, aiomqtt.MqttCodeError) and not isinstance(error, MqttConnectError):
        return "the connection broke"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__
