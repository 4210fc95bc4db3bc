"""Vehicles of a broker, found by what they publish retained: their presence and their description."""

import logging
import secrets
from collections.abc import Callable
from typing import Protocol, TypeVar

import aiomqtt
from pydantic import BaseModel, ValidationError

from companion.adapters.mqtt.connection import Connection
from companion.adapters.mqtt.reconnector import LoggedReconnector, endpoint
from companion.client.broker_connection import first_version
from companion.client.endpoint import url_of
from companion.config.operator_config import OperatorConfig
from companion.protocol.about import About
from companion.protocol.telemetry import Presence
from companion.protocol.topics import VERSION, Topics, is_client

LOG = logging.getLogger(__name__)

_WAITING = 1000
_MOST_VEHICLES = 32
"""More names than this are not believed: anybody who may publish can invent some."""
M = TypeVar("M", bound=BaseModel)


class Finds(Protocol):
    """Receiver of what is found."""

    def note_broker(self, linked: bool, why: str = "") -> None:
        """Take whether the broker is connected, and why not."""

    def note_vehicle(self, name: str) -> None:
        """Take a vehicle's name; not only once."""

    def note_about(self, name: str, about: About | None) -> None:
        """Take a vehicle's description; None when it was taken back."""

    def note_presence(self, name: str, presence: Presence) -> None:
        """Take a vehicle's presence."""


class Discovery:
    """Connection to the broker that finds vehicles, again and again until cancelled."""

    def __init__(self, broker: OperatorConfig, only: tuple[str, ...], finds: Finds) -> None:
        """`only`: vehicles to look at; empty: all. ConfigError for a password or certificate that cannot be read."""
        endpoint(broker, None)
        self._broker, self._only, self._finds = broker, only, finds
        self._found = set(only)
        self._reconnector = _Told(url_of(broker), first_version(broker), finds.note_broker)
        for name in only:
            finds.note_vehicle(name)

    async def run(self) -> None:
        """Look for vehicles until cancelled."""
        await self._reconnector.keep(self._connected)

    async def _connected(self, version: aiomqtt.ProtocolVersion) -> None:
        wire = endpoint(self._broker, None, f"page-{secrets.token_hex(6)}")
        async with Connection(wire, version, _WAITING) as connection:
            for topic in self._topics():
                connection.require_granted(await connection.subscribe(topic, qos=1), topic)
            self._reconnector.heard()
            self._finds.note_broker(True)
            async for message in connection.messages:
                self._read(message)

    def _topics(self) -> list[str]:
        roots = [Topics(self._broker.prefix, name) for name in self._only or ("+",)]
        return [topic for one in roots for topic in (one.status, one.about)]

    def _read(self, message: aiomqtt.Message) -> None:
        """Take one message; ignore anything that is not valid."""
        parts = message.topic.value.split("/")
        if len(parts) != 4 or parts[:2] != [self._broker.prefix, VERSION] or not isinstance(message.payload, bytes):
            return
        name, topic = parts[2:]
        if topic == "status" and (presence := _valid(Presence, message.payload)) and self._is_vehicle(name):
            self._finds.note_vehicle(name)
            self._finds.note_presence(name, presence)
        elif topic == "about" and self._is_vehicle(name):
            self._finds.note_vehicle(name)
            self._finds.note_about(name, _valid(About, message.payload))

    def _is_vehicle(self, name: str) -> bool:
        """Return whether a name is that of a vehicle to show; remember it."""
        if name in self._found:
            return True
        if self._only or not is_client(name) or len(self._found) >= _MOST_VEHICLES:
            return False
        self._found.add(name)
        return True


class _Told(LoggedReconnector):
    """Reconnector that says on the page, too, why there is no connection."""

    def __init__(self, where: str, version: aiomqtt.ProtocolVersion, tell: Callable[[bool, str], None]) -> None:
        super().__init__(f"the broker {where}", version)
        self._where, self._tell_page = where, tell

    def _tell_lost(self, error: Exception) -> None:
        super()._tell_lost(error)
        self._tell_page(False, f"no connection to the broker at {self._where}: {self.why}")


def _valid(model: type[M], payload: bytes) -> M | None:
    try:
        return model.model_validate_json(payload)
    except ValidationError:
        return None
