"""One connection of an operator's client to the broker."""

import contextlib

import aiomqtt
import paho.mqtt.client as paho
from aiomqtt.exceptions import MqttConnectError
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from companion.adapters.mqtt.connection import ANSWER_S, MAX_PACKET_BYTES, V5, V311, Connection
from companion.adapters.mqtt.reconnector import endpoint
from companion.config.operator_config import OperatorConfig
from companion.core.errors import ConfigError
from companion.protocol.topics import Topics

_WAITING = 1000
_SESSION_EXPIRY_S = 60
"""Time an MQTT 5 broker keeps replies for a client whose connection broke."""
_LOCAL_HOSTS = frozenset({"127.0.0.1", "::1", "localhost"})
"""Hosts of the embedded broker, which knows no MQTT 5. A local connection breaks only when the broker ends, so no
broker on these hosts needs to keep replies for this client.
"""
_NOT_ALLOWED_WORDS = ("bad user name or password", "not authorized", "bad username or password", "not authorised")


class ForbiddenError(ConfigError):
    """Rejection by the broker because this user lacks the right."""


class BrokerConnection(Connection):
    """Connection without a last will that ends its session and notices when the broker rejects a command."""

    def __init__(self, place: OperatorConfig, client: str, version: aiomqtt.ProtocolVersion, again: bool) -> None:
        """`again`: what the broker has kept for `client` since the connection before is wanted."""
        super().__init__(endpoint(place, None, client), version, _WAITING)
        self._refused: dict[int, int] = {}
        if version is V5:
            self._clean_start = not again
            bounds = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            bounds.MaximumPacketSize, bounds.SessionExpiryInterval = MAX_PACKET_BYTES, _SESSION_EXPIRY_S
            self._properties = bounds

    async def follow(self, topics: Topics, client: str) -> None:
        """Subscribe to all topics of the service, retained ones too; raise ForbiddenError when one is not granted."""
        subscriptions = [(topics.reply(client), 1), (topics.event, 1), (topics.state, 0), (topics.status, 1)]
        for topic, qos in subscriptions:
            granted = await self.subscribe(topic, qos=qos)
            if any((code if isinstance(code, int) else code.value) >= 0x80 for code in granted):
                raise ForbiddenError(f"does not let us read {topic}")

    async def command(self, topics: Topics, client: str, draft_id: str, payload: bytes) -> None:
        """Publish a command; return when the broker has it.

        Raises ForbiddenError when the broker rejects it, NotSentError when it certainly was not sent, MqttError when
        that is not known.
        """
        properties = None
        if self.version is V5:
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.ResponseTopic, properties.CorrelationData = topics.reply(client), draft_id.encode()
        if self._disconnected.done() or not self._client.is_connected():
            raise NotSentError("the connection is broken")
        reasons: list[ReasonCode] = []
        previous = self._client.on_publish

        def note_reason(
            of: paho.Client, data: object, number: int, reason: ReasonCode, more: Properties
        ) -> None:  # aiomqtt leaves the broker's reason aside
            reasons.append(reason)
            self._on_publish(of, data, number, reason, more)

        self._client.on_publish = note_reason
        try:
            await self.publish(topics.command, payload, qos=1, properties=properties, timeout=3.0 * ANSWER_S)
        finally:
            self._client.on_publish = previous
        if reasons and reasons[0].is_failure:
            raise ForbiddenError(f"does not let us command: {reasons[0].getName().lower()}")

    def farewell(self) -> None:
        """Disconnect and end the session, so that the broker keeps no replies for this client."""
        with contextlib.suppress(Exception):
            if self.version is V5:
                ends = Properties(PacketTypes.DISCONNECT)  # type: ignore[no-untyped-call]
                ends.SessionExpiryInterval = 0
                self._client.disconnect(properties=ends)
            else:
                self._client.disconnect()
            self._client.loop_write()  # now: the socket is closed before the loop comes to it


class NotSentError(aiomqtt.MqttError):
    """Failure to send: the message did not leave this computer."""


def first_version(place: OperatorConfig) -> aiomqtt.ProtocolVersion:
    """Return the version of MQTT to try first at this broker."""
    return V311 if place.host in _LOCAL_HOSTS else V5


def is_forbidden(error: BaseException) -> bool:
    """Return whether the broker refuses the connection because of user or password."""
    if not isinstance(error, MqttConnectError):
        return False
    return any(words in str(error).lower() for words in _NOT_ALLOWED_WORDS)
