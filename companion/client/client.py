"""Operator's client: follows and commands the service over a broker that may be unreachable for a while."""

import asyncio
import contextlib
import secrets
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import TYPE_CHECKING

import aiomqtt
from pydantic import BaseModel, ValidationError

from companion.adapters.mqtt.reconnector import Reconnector, reason_of
from companion.client.broker_connection import BrokerConnection, ForbiddenError, NotSentError, first_version
from companion.client.endpoint import url_of
from companion.client.errors import NoServiceError
from companion.client.first_connection import FirstConnection
from companion.client.inbox import Inbox
from companion.client.messages import Link, Message
from companion.client.runs import Runs
from companion.client.tasks import end
from companion.config.operator_config import OperatorConfig
from companion.core.errors import ConfigError
from companion.protocol.telemetry import Happened, Presence, Reply, State

if TYPE_CHECKING:
    from companion.client.command_draft import CommandDraft

_STATUS_S = 1.5
"""Time to wait for a status: a retained one comes at once, a new broker has it with the service's next one."""
_STATE_S = 2.0
"""Time to wait for a state; they are published ten times a second."""
_CATCH_UP_S = 5.0
"""Longest wait for a state that was not queued in the broker, after a backlog."""


@asynccontextmanager
async def open_console(endpoint: OperatorConfig) -> AsyncIterator["Console"]:
    """Connect to the broker, and reconnect whenever the connection breaks.

    Raises NoServiceError when there is no broker, ConfigError when it refuses the user.
    """
    console = Console(endpoint)
    connecting = asyncio.create_task(console.keep(), name="companion.console")
    try:
        await console.first.wait(connecting)
        yield console
    finally:
        await end(connecting)


class Console:
    """Connected client of one operator, from `open_console`; each reader has its own `inbox`."""

    def __init__(self, endpoint: OperatorConfig) -> None:
        self._endpoint, self._topics = endpoint, endpoint.topics
        self._client = f"console-{secrets.token_hex(6)}"
        self._reconnector = Reconnector(first_version(endpoint), self._lost)
        self._hearers: list[Callable[[Message], None]] = []
        self.first = FirstConnection(endpoint)
        self._connection: BrokerConnection | None = None
        self._runs = Runs()
        self._newest: tuple[Presence | None, Reply | None] = (None, None)
        """Newest presence and newest reply, to drop repetitions."""

    @property
    def vehicle(self) -> str:
        """Name of the vehicle."""
        return self._endpoint.vehicle

    @property
    def where(self) -> str:
        """Vehicle and broker, as part of a sentence."""
        return f"{self._endpoint.vehicle!r} at {url_of(self._endpoint)}"

    @property
    def linked(self) -> bool:
        """True while there is a connection to the broker."""
        return self._connection is not None

    @property
    def presence(self) -> Presence | None:
        """Presence of the followed run of the service, or else the newest one; None before the first."""
        return self._runs.newest_presence

    @property
    def state(self) -> State | None:
        """Newest state of the followed run; None before the first."""
        return self._runs.followed.state if self._runs.followed is not None else None

    def state_age_s(self) -> float:
        """Return the age of the newest state, s; infinite before the first. Callable from any thread."""
        run = self._runs.followed
        return float("inf") if run is None else run.age_s(time.monotonic())

    def state_waited_s(self) -> float:
        """Return the time the newest state was queued on its way, s; 0 when it was not, or the clocks disagree."""
        run = self._runs.followed
        return 0.0 if run is None else run.waited_s

    def replaced(self, session: str) -> bool:
        """Return whether another run of the service has replaced this one."""
        return self._runs.replaced(session, time.monotonic())

    @contextmanager
    def inbox(self) -> Iterator[Inbox]:
        """Give a reader all messages from now on, the service's presence first where it is known."""
        inbox = Inbox()
        if self.presence is not None:
            inbox.put(self.presence)
        with self.heard_by(inbox.put):
            yield inbox

    @contextmanager
    def heard_by(self, hear: Callable[[Message], None]) -> Iterator[None]:
        """Call `hear` with every message; it must not wait."""
        self._hearers.append(hear)
        try:
            yield
        finally:
            self._hearers.remove(hear)

    async def find(self) -> State:
        """Wait for a service and return its state; raise NoServiceError when there is none.

        Only a state proves that a service runs: a retained status may have been left by anybody.
        """
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        while True:
            run, waited_s = self._runs.followed, loop.time() - begun_s
            if run is not None and run.state is not None and run.lives(time.monotonic()):
                if run.caught_up or waited_s > _CATCH_UP_S:
                    return run.state
            elif not self._seems_online and waited_s > _STATUS_S:
                raise NoServiceError(
                    f"no service of {self.where} is running: start `companion serve` on the vehicle's computer"
                )
            elif waited_s > _STATE_S:
                raise NoServiceError(
                    f"no service: that of {self.where} was there, but has sent nothing for {_STATE_S:g} s: "
                    "it hangs, or is cut off from the broker"
                )
            await asyncio.sleep(0.01)

    @property
    def _seems_online(self) -> bool:
        """True when the newest status, which may be a retained one, says that the service is online."""
        return self.presence is not None and self.presence.online

    async def send(self, draft: "CommandDraft") -> bool:
        """Send a command to the followed run of the service; return whether the broker certainly has it.

        Raises NotSentError when it certainly was not sent, ConfigError when the broker rejects commands of this user.
        """
        connection, run = self._connection, self._runs.followed
        if connection is None or run is None:
            raise NotSentError("the connection is broken")
        payload = draft.payload(run.session, run.service_time_s(time.monotonic()), self._client)
        try:
            await connection.command(self._topics, self._client, draft.id, payload)
        except ForbiddenError as error:
            raise ConfigError(f"{url_of(self._endpoint)} {error}") from error
        except NotSentError:
            raise
        except (aiomqtt.MqttError, OSError):
            return False
        return True

    async def keep(self) -> None:
        """Keep the connection until cancelled; `first.wait` raises the error of the first attempt."""
        await self._reconnector.keep(self._follow)

    async def _follow(self, version: aiomqtt.ProtocolVersion) -> None:
        """Run one connection until it breaks; raise what broke it."""
        async with BrokerConnection(self._endpoint, self._client, version, self.first.made) as connection:
            await connection.follow(self._topics, self._client)
            self._reconnector.heard()
            self._connection = connection
            if self.first.made:
                self._tell(Link(True))
            self.first.make()
            try:
                async for message in connection.messages:
                    self._read(message)
            except asyncio.CancelledError:
                connection.farewell()
                raise

    def _lost(self, error: Exception) -> None:
        """Raise the error of the first connection as a sentence; report a later one that broke as an event."""
        if not self.first.made:
            self.first.fail(error)
        if self._connection is not None:
            self._connection = None
            self._tell(Link(False, f"no connection to {url_of(self._endpoint)} any more: {reason_of(error)}"))

    def _read(self, message: aiomqtt.Message) -> None:
        """Take one message of the service; ignore anything that is not valid."""
        models: dict[str, type[Reply | Happened | State | Presence]] = {
            self._topics.reply(self._client): Reply,
            self._topics.event: Happened,
            self._topics.state: State,
            self._topics.status: Presence,
        }
        model = models.get(message.topic.value)
        if model is None or (message.retain and model is not Presence) or not isinstance(message.payload, bytes):
            return
        with contextlib.suppress(ValidationError):
            self._note(model.model_validate_json(message.payload))

    def _note(self, message: BaseModel) -> None:
        if message in self._newest:
            return  # a repeated status of the service, or a reply sent twice because it was not acknowledged
        presence, reply = self._newest
        if isinstance(message, Presence):
            self._newest = message, reply
            self._runs.note_presence(message)
        if isinstance(message, Reply):
            self._newest = presence, message
        if isinstance(message, State) and not self._runs.note_state(message, time.monotonic(), time.time()):
            return  # from another run: two services use this vehicle's name
        if isinstance(message, Presence | State | Happened | Reply):
            self._tell(message)

    def _tell(self, message: Message) -> None:
        for hear in tuple(self._hearers):
            hear(message)
