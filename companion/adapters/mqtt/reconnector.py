"""Broker endpoint from a configuration table, and connections to it, again and again, by the MQTT that it speaks."""

import asyncio
import logging
import secrets
import ssl
import time
from collections.abc import Awaitable, Callable

import aiomqtt
from aiomqtt.exceptions import MqttConnectError

from companion.adapters.mqtt.connection import V5, V311, Endpoint, UnansweredError, knows_no_mqtt5
from companion.config.operator_config import OperatorConfig
from companion.core.errors import ConfigError

LOG = logging.getLogger(__package__)

_FIRST_PAUSE_S = 0.2
_LONGEST_PAUSE_S = 2.0
_SPOKEN = {V5: "5", V311: "3.1.1"}


_NOT_YET, _EXPIRED, _NAME, _ADDRESS = 9, 10, 62, 64
"""OpenSSL's X509_V_ERR_CERT_NOT_YET_VALID, _CERT_HAS_EXPIRED, _HOSTNAME_MISMATCH and _IP_ADDRESS_MISMATCH."""
_MAKE = "config/mosquitto/make-certificates.sh"


def endpoint(config: OperatorConfig, will: aiomqtt.Will | None, identifier: str = "") -> Endpoint:
    """Return the endpoint; ConfigError when password or certificate cannot be read.

    Without an `identifier` the client has a random one, as a broker closes the older of two connections with one name.
    """
    tls = None
    if config.tls:
        try:
            tls = ssl.create_default_context(cafile=config.ca_file)
        except (OSError, ssl.SSLError) as error:
            where = f"{config.table}.ca_file = {config.ca_file!r}"
            raise ConfigError(f"{where}: no certificates can be read: {error}") from error
    return Endpoint(
        host=config.host,
        port=config.port,
        identifier=identifier or f"{config.prefix}-{config.vehicle}-{secrets.token_hex(4)}",
        user=config.user,
        password=config.password(),
        tls=tls,
        will=will,
    )


def certificate_fault(error: ssl.SSLError) -> str:
    """Return what is wrong with the broker's TLS and the remedy, as a part of a sentence."""
    if not isinstance(error, ssl.SSLCertVerificationError):
        return f"{error.reason or error}: does the broker speak TLS on this port?"
    return f"certificate verify failed: {error.verify_message.rstrip('.')}: {_remedy(error.verify_code)}"


def _remedy(code: int) -> str:
    if code in {_NOT_YET, _EXPIRED}:
        today = time.strftime("%Y-%m-%d", time.localtime())
        return f"renew the broker's certificate ({_MAKE}), or set this computer's clock, which says {today}"
    if code in {_NAME, _ADDRESS}:
        return f"use a name that the certificate is for, or make one for this name ({_MAKE})"
    return "is the CA file (--ca-file, or ca_file in the configuration) the one that signed its certificate?"


class Reconnector:
    """Reconnection to one broker. A connection calls `heard` whenever the broker has answered."""

    def __init__(self, version: aiomqtt.ProtocolVersion, on_lost: Callable[[Exception], None]) -> None:
        """`version` is tried first; `on_lost` is told why a connection failed or broke: what it raises ends `keep`."""
        self.version = version
        self.there = False
        """True once it has answered in this connection."""
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
