"""First connection of a client to its broker: waited for within a limit, and its failure is one sentence."""

import asyncio
import socket
import ssl

import aiomqtt
from aiomqtt.exceptions import MqttConnectError

from companion.adapters.mqtt.reconnector import certificate_fault, reason_of
from companion.client.broker_connection import ForbiddenError, is_forbidden
from companion.client.endpoint import url_of
from companion.client.errors import NoServiceError
from companion.config.operator_config import OperatorConfig
from companion.core.errors import ConfigError

_TIMEOUT_S = 15.0
"""Timeout of all attempts, name resolution included."""
_TRIES = 3
"""Attempts, where the next one may succeed."""


class FirstConnection:
    """Attempts at the first connection to one broker."""

    def __init__(self, endpoint: OperatorConfig) -> None:
        self._endpoint, self._tries = endpoint, 0
        self._made: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    @property
    def made(self) -> bool:
        """True once there was a connection."""
        return self._made.done()

    def make(self) -> None:
        """Note that there is a connection."""
        if not self.made:
            self._made.set_result(None)

    def fail(self, error: Exception) -> None:
        """Note a failed attempt; raise it as a sentence when another attempt is of no use."""
        self._tries += 1
        if self._tries == _TRIES or not may_be_chance(error):
            raise refused_connection(error, self._endpoint)

    async def wait(self, connecting: "asyncio.Task[None]") -> None:
        """Wait until it is made; raise the error of the task that connects, or NoServiceError after the timeout."""
        await asyncio.wait({self._made, connecting}, timeout=_TIMEOUT_S, return_when=asyncio.FIRST_COMPLETED)
        if self.made:
            return
        if connecting.done():
            connecting.result()
        raise NoServiceError(
            f"no connection to the broker at {url_of(self._endpoint)} within {_TIMEOUT_S:g} s, so it is not "
            "known whether the service runs"
        )


def may_be_chance(error: Exception) -> bool:
    """Return whether the next attempt may succeed: the broker accepted the connection but did not answer."""
    return isinstance(error, aiomqtt.MqttError) and not isinstance(error, MqttConnectError)


def refused_connection(error: Exception, endpoint: OperatorConfig) -> Exception:
    """Return the exception for the operator: one sentence, or the error itself when it is a defect."""
    url = url_of(endpoint)
    if isinstance(error, ForbiddenError):
        return ConfigError(f"{url} {error}")
    if isinstance(error, ConfigError) or not isinstance(error, aiomqtt.MqttError | OSError | ValueError):
        return error
    if is_forbidden(error):
        return ConfigError(f"{url} rejects the connection: give --broker mqtt://USER@HOST and --password-file")
    if isinstance(error, ssl.SSLError):
        return ConfigError(f"{url}: {certificate_fault(error)}")
    if isinstance(error, ConnectionRefusedError | socket.gaierror):
        return NoServiceError(
            f"no broker at {url} ({reason_of(error)}): start `companion serve`, which has one, or another broker there"
        )
    return NoServiceError(
        f"the broker at {url} does not answer ({reason_of(error)}), so it is not known whether the "
        "service runs: look at the broker; the pilot's remote control works without it"
    )
