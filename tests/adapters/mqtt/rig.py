"""The service's end of the bus and an operator, on a real broker."""

import asyncio
import json
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from companion.adapters.mqtt import link as bus_link
from companion.adapters.mqtt.link import Answering, BusLink
from companion.adapters.system.clock import MonotonicClock
from companion.config.operator_config import OperatorConfig
from companion.protocol.about import About
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Reply, State
from companion.protocol.topics import Topics

CLOCK = MonotonicClock()
PATIENCE_S = 15.0
SESSION = "0123456789abcdef"
TOPICS = Topics("dauam", "vehicle")
V5, V311 = aiomqtt.ProtocolVersion.V5, aiomqtt.ProtocolVersion.V311


class Vehicle:
    """The link's end of the flight; what it is commanded is done at once."""

    def __init__(self) -> None:
        self.commands: list[Command] = []
        self.error: Exception | None = None

    def on_command(self, command: Command, answer: Answering) -> None:
        self.commands.append(command)
        if self.error is not None:
            raise self.error
        for what in (Answer.ACCEPTED, Answer.DONE):
            answer(Reply(id=command.id, answer=what, time_s=time.time()))

    @property
    def told(self) -> list[tuple[str, str]]:
        """Verb and id of every command."""
        return [(command.verb, command.id) for command in self.commands]


@asynccontextmanager
async def linked(port: int, vehicle: Vehicle, about: About | None = None, /, **config: Any) -> AsyncIterator[BusLink]:
    """Open the link, with or without a broker, with a short search for another service."""
    with patch.object(bus_link, "LISTEN_S", 0.02):
        link = BusLink(OperatorConfig(port=port, **config), CLOCK, SESSION, about)
        async with link.listening(vehicle.on_command):
            yield link


@dataclass(frozen=True)
class Said:
    """Message received from the broker: topic, payload and properties."""

    topic: str
    payload: bytes
    correlation: bytes | None

    @property
    def json(self) -> dict[str, Any]:
        read: dict[str, Any] = json.loads(self.payload)
        return read


def command(verb: str, name: str, **changes: Any) -> bytes:
    """Return a valid command with these changes."""
    return json.dumps({"verb": verb, "id": name, "session": SESSION, "sent_s": time.time()} | changes).encode()


def state(time_s: float) -> State:
    """Return the telemetry of a vehicle in hold."""
    unknown = dict.fromkeys(State.model_fields)
    known = {"time_s": time_s, "session": SESSION, "phase": "hold", "reason": "", "armed": True, "in_air": True}
    rest = {
        "mode": "OFFBOARD",
        "controller": "etnn",
        "faults": (),
        "late_s": 0.0,
        "record": "",
        "text": "",
        "warnings": (),
        "others": (),
    }
    return State.model_validate(unknown | known | rest)


class Operator:
    """A laptop on the same broker."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self._client = client
        self.heard: list[Said] = []
        self._ids = 0

    async def say(self, payload: bytes, topic: str = TOPICS.command, retain: bool = False, **properties: Any) -> None:
        """Publish a message; `properties` by their names in MQTT 5."""
        said = Properties(PacketTypes.PUBLISH) if properties else None  # type: ignore[no-untyped-call]
        for name, value in properties.items():
            setattr(said, name, value)
        await self._client.publish(topic, payload, qos=1, retain=retain, properties=said)

    async def order(self, verb: str, **changes: Any) -> str:
        """Send one command with an id of its own, which is returned."""
        self._ids += 1
        name = str(changes.get("id", f"{id(self)}-{self._ids}"))
        await self.say(command(verb, name, **changes))
        return name

    async def hears(self, topic: str, **fields: Any) -> Said:
        """Wait for the first message on a topic with these fields; earlier ones are discarded."""

        def fits(said: Said) -> bool:
            return said.topic == topic and said.json.items() >= fields.items()

        await until(lambda: any(fits(said) for said in self.heard))
        while not fits(said := self.heard.pop(0)):
            pass
        return said

    async def refusal(self, name: str = "") -> str:
        """Return the reason of a refusal that is published as an event."""
        return str((await self.hears(TOPICS.event, kind="reply", name="refused", id=name)).json["text"])

    async def listen(self) -> None:
        async for message in self._client.messages:
            assert isinstance(message.payload, bytes)
            if message.topic.value != TOPICS.command:
                back = getattr(message.properties, "CorrelationData", None)
                self.heard.append(Said(message.topic.value, message.payload, back))


@asynccontextmanager
async def operating(port: int, version: aiomqtt.ProtocolVersion = V311, **client: Any) -> AsyncIterator[Operator]:
    """Connect an operator who receives every topic of the vehicle."""
    at_once = [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)]
    async with aiomqtt.Client("127.0.0.1", port, protocol=version, socket_options=at_once, **client) as connected:
        operator = Operator(connected)
        await connected.subscribe(f"{TOPICS.root}/#", qos=1)
        listening = asyncio.create_task(operator.listen(), name="operator")
        try:
            yield operator
        finally:
            listening.cancel()
            await asyncio.wait([listening])
    await asyncio.sleep(0.01)  # its own last task ends a little later


@asynccontextmanager
async def operated(
    port: int, vehicle: Vehicle, version: aiomqtt.ProtocolVersion = V311
) -> AsyncIterator[tuple[BusLink, Operator]]:
    """Open the link, and then an operator, on one broker."""
    async with linked(port, vehicle, embedded=version is V311) as link:
        await until(lambda: link.age_s() == 0.0)
        async with operating(port, version) as operator:
            yield link, operator


async def until(holds: Callable[[], object]) -> None:
    """Wait for something that has to come; fails when it does not."""
    async with asyncio.timeout(PATIENCE_S):
        while not holds():  # noqa: ASYNC110  # nobody signals: it is a status that is looked at
            await asyncio.sleep(0.005)


@asynccontextmanager
async def ticking() -> AsyncIterator[list[float]]:
    """Run a task every 10 ms like the flight loop; the list holds the longest pause so far, s."""
    longest = [0.0]

    async def tick() -> None:
        last_s = time.monotonic()
        while True:
            await asyncio.sleep(0.01)
            now_s = time.monotonic()
            longest[0], last_s = max(longest[0], now_s - last_s), now_s

    task = asyncio.create_task(tick(), name="ticker")
    try:
        yield longest
    finally:
        task.cancel()
        await asyncio.wait([task])


def open_files() -> int:
    """Return the number of open files of this process, sockets included."""
    return len(list(Path("/proc/self/fd").iterdir()))
