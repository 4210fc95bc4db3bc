"""Vehicles whose services are on a broker, found by what the services publish."""

import asyncio
from collections.abc import AsyncIterator, Collection, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any

import aiomqtt
from pydantic import ValidationError

from companion.adapters.mqtt.connection import Connection
from companion.adapters.mqtt.reconnector import Reconnector, endpoint
from companion.client.broker_connection import ForbiddenError, first_version
from companion.client.endpoint import EndpointOptions, endpoint_of, url_of
from companion.client.errors import NoServiceError
from companion.client.first_connection import FirstConnection
from companion.client.tasks import end
from companion.config.operator_config import OperatorConfig
from companion.core.errors import CompanionError
from companion.protocol.telemetry import Presence
from companion.protocol.topics import Topics, is_vehicle

_WAITING = 1000
_LISTEN_S = 0.5
"""Time to listen: a service publishes ten states a second, and the retained statuses come at once."""
_HESITATE_S = 2.0
"""Longest time to listen, for the first state of a service whose status says that it is online."""
_LOOK_S = 0.05
_PATIENCE_S = 3.0
"""Time that somebody waits who has pressed TAB."""


class Roster:
    """Names of the vehicles on one broker, as they are heard."""

    def __init__(self, place: OperatorConfig) -> None:
        self._place, self._topics = place, Topics(place.prefix, "+")
        self._reconnector = Reconnector(first_version(place), self._lost)
        self.first = FirstConnection(place)
        self._alive: set[str] = set()
        self._heard = asyncio.Event()
        self._online: dict[str, bool] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Vehicles of which a state was heard, or whose newest status says online, in alphabetical order."""
        return tuple(sorted(self._alive | {name for name, online in self._online.items() if online}))

    @property
    def settled(self) -> bool:
        """True when a state of every vehicle that is said to be online was heard."""
        return bool(self._alive) and self._alive.issuperset(self.names)

    async def next_beside(self, known: Collection[str]) -> str:
        """Wait for a state of a vehicle other than these, from now on; return its name."""
        self._alive.clear()
        while not (new := self._alive.difference(known)):
            self._heard.clear()
            await self._heard.wait()
        return min(new)

    async def keep(self) -> None:
        """Listen until cancelled; raise the error of the first connection."""
        await self._reconnector.keep(self._follow)

    async def _follow(self, version: aiomqtt.ProtocolVersion) -> None:
        async with Connection(endpoint(self._place, None), version, _WAITING) as connection:
            for topic in (self._topics.status, self._topics.state):
                try:
                    connection.require_granted(await connection.subscribe(topic, qos=0), topic)
                except aiomqtt.MqttError as error:
                    raise ForbiddenError(f"does not let us read {topic}: name the vehicles instead of all") from error
            self._reconnector.heard()
            self.first.make()
            async for message in connection.messages:
                self._note(message)

    def _note(self, message: aiomqtt.Message) -> None:
        *_, name, kind = message.topic.value.split("/")
        if not is_vehicle(name):
            return
        if kind == "status" and isinstance(message.payload, bytes):
            with suppress(ValidationError):
                self._online[name] = Presence.model_validate_json(message.payload).online
        elif kind == "state" and not message.retain:
            self._alive.add(name)
            self._heard.set()

    def _lost(self, error: Exception) -> None:
        if not self.first.made:
            self.first.fail(error)


@asynccontextmanager
async def open_roster(place: OperatorConfig) -> AsyncIterator[Roster]:
    """Listen on the broker of `place` for the vehicles of its prefix.

    Raises NoServiceError when there is no broker, ConfigError when it refuses the user.
    """
    roster = Roster(place)
    listening = asyncio.create_task(roster.keep(), name="companion.roster")
    try:
        await roster.first.wait(listening)
        yield roster
    finally:
        await end(listening)


async def vehicles_at(place: OperatorConfig) -> tuple[str, ...]:
    """Return the vehicles online on the broker of `place`; NoServiceError when there is none."""
    async with open_roster(place) as roster:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        while (waited_s := loop.time() - begun_s) < (_LISTEN_S if roster.settled else _HESITATE_S):
            await asyncio.sleep(_LOOK_S)
            if not roster.names and waited_s > _LISTEN_S:
                break
        if not roster.names:
            raise NoServiceError(
                f"no vehicle is online at {url_of(place)} under {place.prefix!r}: start `companion serve` on each "
                "vehicle's computer"
            )
        return roster.names


async def others_online(place: OperatorConfig) -> str:
    """Return which vehicles are online where that of `place` is not, as the end of a sentence; empty if unknown."""
    try:
        async with asyncio.timeout(_PATIENCE_S):
            names = [name for name in await vehicles_at(place) if name != place.vehicle]
    except (CompanionError, TimeoutError):
        return ""
    return f"; online there: {', '.join(names)} (--vehicle NAME, or all)" if names else ""


def names_for_completion(given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the vehicles online at the broker of these `EndpointOptions`; none when they cannot be had at once."""
    try:
        return asyncio.run(asyncio.wait_for(_names(EndpointOptions(**given, vehicle="unnamed")), _PATIENCE_S))
    except (CompanionError, TimeoutError):
        return ()


async def _names(given: EndpointOptions) -> tuple[str, ...]:
    return await vehicles_at(endpoint_of(given))
