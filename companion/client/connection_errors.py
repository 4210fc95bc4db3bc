"""Error messages for a failed first connection to the broker."""

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
