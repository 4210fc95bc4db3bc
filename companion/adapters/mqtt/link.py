"""Commands in; replies, events, state and presence out: over a broker that may be gone at any time."""

import asyncio
import itertools
import logging
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial

import aiomqtt
from pydantic import BaseModel

from companion import __version__
from companion.adapters.mqtt.connection import V5, V311, Connection
from companion.adapters.mqtt.neighbours import Neighbours
from companion.adapters.mqtt.outbox import Outbox, OutboxMessage, ReplyAddress
from companion.adapters.mqtt.reconnector import LoggedReconnector, endpoint
from companion.adapters.mqtt.rival import LISTEN_S, Rival
from companion.adapters.system.background import background
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import Clock, CompanionError
from companion.core.types import OtherService
from companion.protocol.about import About
from companion.protocol.commands import Command
from companion.protocol.intake import Intake, Refusal
from companion.protocol.intent import Intent
from companion.protocol.telemetry import Answer, Happened, Presence, Reply, State

LOG = logging.getLogger(__name__)

_BEAT_S = 0.5
"""With the time-out of an answer, a broker that hangs is noticed after 1.5 s."""
_ECHO_BEATS = 10
"""Beats within which the first comes back to us, too, if the broker lets us read there."""
_LAST_WORDS_S = 0.5
_WAITING = 64
"""Commands that wait to be read, and refusals to be said; what is more is lost."""
_EVENTS = 256
_REPLIES = 256

Answering = Callable[[Reply], None]
"""Sends a reply to the sender of the command; never waits, never raises, may be called at any later time."""
OnCommand = Callable[[Command, Answering], None]


class BusLink:
    """OperatorLink interface, and the service's telemetry and events; for one event loop only."""

    def __init__(self, config: OperatorConfig, clock: Clock, session: str, about: About | None = None) -> None:
        """`session` is new for every run, 16 hex digits. ConfigError when password or certificate cannot be read.

        `about` is published, retained, on every new connection.
        """
        self._clock, self._about = clock, about
        self._topics = config.topics
        self._intake = Intake(session)
        self._presence = Presence(
            online=True,
            session=session,
            vehicle=config.vehicle,
            body="" if about is None else about.body,
            host=socket.gethostname(),
            version=__version__,
            since_s=time.time(),
        )
        gone = self._presence.model_copy(update={"online": False}).model_dump_json().encode()
        self._endpoint = endpoint(config, aiomqtt.Will(self._topics.status, gone, qos=1, retain=True))
        self._where = f"{config.host}:{config.port}"
        self._rival = Rival(self._presence, self._topics.status, self._where, clock)
        self.neighbours = Neighbours(self._presence, self._topics, clock)
        """Services of other vehicles on the broker."""
        self._intent: bytes | None = None
        """Newest announcement, empty when it was taken back; None before the first."""
        self._intent_changed = asyncio.Event()
        self._listened = asyncio.Event()
        if config.embedded:  # the broker has just begun with us
            self._listened.set()
        self._broker_link = LoggedReconnector(f"the operator's broker {self._where}", V311 if config.embedded else V5)
        self._events, self._replies = Outbox(_EVENTS), Outbox(_REPLIES)
        self._state: State | None = None
        self._shown = asyncio.Event()
        self._answered_s = clock.now_s()
        self._objection = ""
        self._deaf = False

    def age_s(self) -> float:
        """Return the time since the broker last answered, s; 0 while it does."""
        return 0.0 if self._broker_link.there else self._clock.now_s() - self._answered_s

    def others(self) -> tuple[OtherService, ...]:
        """Return the services of other vehicles that are heard now."""
        return tuple(OtherService(one.vehicle, one.body) for one in self.neighbours.present())

    def rival(self) -> str:
        """Return what is wrong when another service has this vehicle's name or body; empty when none is heard."""
        return self._rival.sentence or self.neighbours.rival

    async def listened(self, timeout_s: float) -> None:
        """Wait until another service would have been heard, or until there was no broker for that time."""
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                await self._listened.wait()

    def tell(self, happened: Happened) -> None:
        """Say it to everyone, later if there is no broker now; of very many the oldest are dropped. Never waits."""
        self._put(self._events, self._topics.event, happened)

    def show(self, state: State) -> None:
        """Say it to everyone, if there is a broker and nothing newer. Never waits."""
        self._state = state
        self._shown.set()

    def announce(self, intent: Intent | None) -> None:
        """Say to the other vehicles where this one will fly, once there is a broker; None: nowhere. Never waits."""
        self._intent = b"" if intent is None else intent.model_dump_json().encode()
        self._intent_changed.set()

    @asynccontextmanager
    async def listening(self, on_command: OnCommand) -> AsyncIterator[None]:
        """Take commands from now on; continue in the background while there is no broker. Raises nothing.

        `on_command` is called on this event loop for every valid command, and must not wait; a CompanionError that it
        raises is answered with a refusal.
        """
        async with background(self._broker_link.keep(partial(self._connected, on_command)), "companion.bus"):
            yield
            await self._last_words()

    async def _last_words(self) -> None:
        with suppress(TimeoutError):
            async with asyncio.timeout(_LAST_WORDS_S if self._broker_link.there else 0.0):
                await asyncio.gather(self._replies.empty(), self._events.empty())

    async def _connected(self, on_command: OnCommand, version: aiomqtt.ProtocolVersion) -> None:
        """Run one connection until it breaks; raises what broke it."""
        async with Connection(self._endpoint, version, _WAITING) as broker:
            await broker.listen_to(self._topics.command)
            for topic in (self._topics.status, *self.neighbours.topics):
                await broker.subscribe(topic, qos=0)  # whether it lets us shows in what comes
            if self._intent is not None:
                self._intent_changed.set()
            async with asyncio.TaskGroup() as group:
                group.create_task(self._listen(broker, on_command), name="companion.bus.listen")
                if not self._listened.is_set():  # once in a run: later the vehicle may fly
                    await asyncio.sleep(LISTEN_S)
                    self._listened.set()
                group.create_task(self._beat(broker), name="companion.bus.beat")
                group.create_task(self._publish_from(broker, self._replies), name="companion.bus.replies")
                group.create_task(self._publish_from(broker, self._events), name="companion.bus.events")
                group.create_task(self._publish_state(broker), name="companion.bus.state")
                group.create_task(self._publish_intent(broker), name="companion.bus.intent")

    async def _beat(self, broker: Connection) -> None:
        """Publish our presence again and again: a broker that hangs is noticed, which TCP alone would not show.

        And the last will of a broken connection may come after the first presence of the next one.
        """
        online = self._presence.model_dump_json().encode()
        if self._about is not None and not self._rival.sentence:
            await broker.publish(self._topics.about, self._about.model_dump_json().encode(), qos=1, retain=True)
        for beat in itertools.count():
            await broker.publish(self._topics.status, online, qos=1, retain=True)
            broker.check()
            self._answered_s = self._clock.now_s()
            self._broker_link.heard()
            if broker.objection and broker.objection != self._objection:
                self._objection = broker.objection
                LOG.warning("the operator's broker does not forward %s/...: %s", self._topics.root, self._objection)
            if beat == _ECHO_BEATS and not self._rival.echoed and not self._deaf:
                self._deaf = True
                unseen = "another service with this vehicle's name would not be noticed"
                LOG.warning("the broker %s does not let us read %s: %s", self._where, self._topics.status, unseen)
            await asyncio.sleep(_BEAT_S)

    async def _listen(self, broker: Connection, on_command: OnCommand) -> None:
        async for message in broker.messages:
            if message.topic.value == self._topics.command:  # some brokers send what was not subscribed to
                self._take(message, on_command)
            elif message.topic.value == self._topics.status:
                if self._rival.note(message):
                    LOG.error("%s", self._rival.sentence)
            elif self.neighbours.note(message):
                LOG.error("%s", self.neighbours.rival)

    def _take(self, message: aiomqtt.Message, on_command: OnCommand) -> None:
        payload = message.payload if isinstance(message.payload, bytes) else b""
        path = ReplyAddress.of(message, self._topics)
        if message.retain:
            refusal = self._intake.refuse(payload, "a retained command is an old one: publish it without retain")
            return self._refuse(path, refusal)
        taken = self._intake.take(payload, time.time())
        if isinstance(taken, Refusal):
            return self._refuse(path, taken)
        self._hand_on(taken, path.named(taken.reply_to), on_command)
        return None

    def _hand_on(self, command: Command, path: ReplyAddress, on_command: OnCommand) -> None:
        LOG.info("the operator commands %s (%s)", command.verb, command.id)

        def answer(reply: Reply) -> None:
            self._answer(path, reply)

        def end(what: Answer, text: str) -> None:
            answer(Reply(id=command.id, answer=what, time_s=time.time(), text=text))

        try:
            on_command(command, answer)
        except CompanionError as error:
            end(Answer.REFUSED, str(error))
        except Exception as error:
            LOG.exception("the command %s (%s) failed", command.verb, command.id)
            end(Answer.FAILED, type(error).__name__)

    def _refuse(self, path: ReplyAddress, refusal: Refusal) -> None:
        """Publish a refusal without waiting: the next command may be an abort."""
        if not self._listened.is_set() or len(self._replies) >= _WAITING:
            return  # nobody knows of us yet, so that another was meant; or a flood: what fits in says enough
        LOG.warning("a command is refused: %r", refusal.reason)  # %r: it may hold what the sender wrote
        reply = Reply(id=refusal.id, answer=Answer.REFUSED, time_s=time.time(), text=refusal.reason)
        self._answer(path.named(refusal.reply_to), reply)

    def _answer(self, path: ReplyAddress, reply: Reply) -> None:
        reply = reply.model_copy(update={"session": self._presence.session})
        self._put(self._replies, path.topic, path.message(reply), path.correlation)

    def _put(self, box: Outbox, topic: str, said: BaseModel, correlation: bytes | None = None) -> None:
        try:
            box.put(OutboxMessage(topic, said.model_dump_json().encode(), correlation))
        except Exception:  # text that is no Unicode, data that is no JSON
            LOG.exception("cannot be said over the bus: %r", type(said).__name__)

    async def _publish_from(self, broker: Connection, box: Outbox) -> None:
        while True:
            message = await box.next()
            properties = message.properties() if broker.version is V5 else None
            try:
                await broker.publish(message.topic, message.payload, qos=1, properties=properties)
            except BaseException:
                box.not_published(message)
                raise
            box.published()

    async def _publish_intent(self, broker: Connection) -> None:
        while True:
            await self._intent_changed.wait()
            self._intent_changed.clear()
            await broker.publish(self._topics.intent, self._intent or b"", qos=1, retain=True)

    async def _publish_state(self, broker: Connection) -> None:
        while True:
            await self._shown.wait()
            self._shown.clear()
            if self._state is not None:
                await broker.publish(self._topics.state, self._state.model_dump_json().encode(), qos=0)
