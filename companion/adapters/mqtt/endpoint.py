"""Broker endpoint from a table of the configuration."""

import secrets
import ssl

import aiomqtt

from companion.adapters.mqtt.connection import Endpoint
from companion.config.operator_config import OperatorConfig
from companion.core.errors import ConfigError


def endpoint(config: OperatorConfig, will: aiomqtt.Will | None) -> Endpoint:
    """Return the endpoint with a random client identifier; ConfigError when password or certificate cannot be read."""
    tls = None
    if config.tls:
        try:
            tls = ssl.create_default_context(cafile=config.ca_file)
        except (OSError, ssl.SSLError) as error:
            where = f"{config.table}.ca_file = {config.ca_file!r}"
            raise ConfigError(f"{where}: no certificates can be read: {error}") from error
    # random, as a broker closes the older of two connections with one name
    name = f"{config.prefix}-{config.vehicle}-{secrets.token_hex(4)}"
    return Endpoint(config.host, config.port, name, config.user, config.password(), tls, will)
