"""Vehicles that the page follows and commands: one console for each."""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import aclosing

from companion.client.client import Console, open_console
from companion.client.command_draft import CommandDraft
from companion.client.messages import Message
from companion.client.pending_command import PendingCommand
from companion.config.operator_config import OperatorConfig
from companion.core.errors import CompanionError
from companion.page.discovery import Discovery
from companion.page.hub import Hub
from companion.protocol.about import About
from companion.protocol.telemetry import Happened, Presence, Reply, State

LOG = logging.getLogger(__name__)

_AGAIN_S = 2.0
_BEAT_S = 0.2


class NotConnectedError(CompanionError):
    """No connection to the broker, or not to this vehicle's topics; nothing was sent."""


class Vehicles:
    """Follower of every vehicle that is found."""

    def __init__(self, broker: OperatorConfig, only: tuple[str, ...], hub: Hub) -> None:
        """`only`: vehicles to follow; empty: all. ConfigError for a password or certificate that cannot be read."""
        self._broker, self._hub = broker, hub
        self._consoles: dict[str, Console] = {}
        self._new: asyncio.Queue[str] = asyncio.Queue()
        self._discovery = Discovery(broker, only, self)

    async def run(self) -> None:
        """Follow all vehicles until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._discovery.run(), name="companion.page.discovery")
            group.create_task(self._beat(), name="companion.page.beat")
            while True:
                name = await self._new.get()
                group.create_task(self._follow(name), name=f"companion.page.{name}")

    async def execute(self, vehicle: str, draft: CommandDraft) -> AsyncIterator[Reply]:
        """Send a command and yield its replies to the last; raise CompanionError when it is not known how it ends."""
        console = self._consoles.get(vehicle)
        if console is None:
            raise NotConnectedError(f"{draft.verb}: nothing was sent: there is no connection to the broker")
        async with aclosing(PendingCommand(console, draft).messages()) as messages:
            async for message in messages:
                if isinstance(message, Reply) and message.id == draft.id:
                    yield message

    def note_broker(self, linked: bool, why: str = "") -> None:
        """Take whether the broker is connected, and why not."""
        self._hub.note_broker(linked, why)

    def note_vehicle(self, name: str) -> None:
        """Follow a vehicle, once."""
        if name not in self._hub.vehicles:
            self._hub.note_vehicle(name)
            self._new.put_nowait(name)

    def note_about(self, name: str, about: About | None) -> None:
        """Take a vehicle's description."""
        self._hub.note_about(name, about)

    def note_presence(self, name: str, presence: Presence) -> None:
        """Take a vehicle's presence."""
        self._hub.note_presence(name, presence)

    async def _beat(self) -> None:
        while True:
            self._hub.beat()
            await asyncio.sleep(_BEAT_S)

    async def _follow(self, name: str) -> None:
        """Follow one vehicle for ever; its console reconnects by itself once it has been connected."""
        place, said = self._broker.model_copy(update={"vehicle": name}), ""
        while True:
            try:
                async with open_console(place) as console:
                    self._consoles[name] = console
                    await self._hear(name, console)
            except CompanionError as error:
                if str(error) != said:
                    said = str(error)
                    LOG.warning("%s: %s", name, said)
            finally:
                self._consoles.pop(name, None)
            await asyncio.sleep(_AGAIN_S)

    async def _hear(self, name: str, console: Console) -> None:
        def hear(message: Message) -> None:
            if isinstance(message, State):
                self._hub.note_state(name, message, console.state_age_s())
            elif isinstance(message, Happened):
                self._hub.note_event(name, message)

        with console.heard_by(hear):
            await asyncio.Event().wait()
