"""A service that speaks the bus over a real broker and does as a test's script says."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any

import aiomqtt

from companion.adapters.mqtt.connection import Connection
from companion.client.tasks import end
from companion.protocol.commands import Command
from companion.protocol.intake import Intake, Refusal
from companion.protocol.telemetry import Answer, Doing, Happened, Kind, Presence, Reply, State
from companion.protocol.topics import Topics

SESSION = "0123456789abcdef"
_PERIOD_S = 0.05
_PATIENCE_S = 30.0

Answers = AsyncIterator[tuple[Answer, str]]
Script = Callable[["ScriptedService", Command], Answers]


class Client(aiomqtt.Client):
    """One whose tasks end when they are cancelled once.

    aiomqtt waits with wait_for, which on Python 3.11 loses a cancellation that comes together with the answer; a
    TaskGroup cancels its tasks once only, and then waits for them for ever.
    """

    _wait_for = Connection._wait_for


async def done(service: "ScriptedService", command: Command) -> Answers:
    """Every command succeeds at once."""
    yield Answer.ACCEPTED, "it begins"
    yield Answer.DONE, f"{command.verb} is done"


class ScriptedService:
    """Its clock is an hour ahead, as when nobody sets it."""

    def __init__(self, port: int, vehicle: str, script: Script, session: str) -> None:
        self.topics = Topics("dauam", vehicle)
        self.taken: list[Command] = []
        self.refusals: list[Refusal] = []
        self.session, self.phase, self.armed, self.height_m = session, "standby", False, 0.0
        self.data: dict[str, Any] = {}
        self.doing: Doing | None = None
        self.silent = False
        self._port, self._script = port, script
        self._clock_s = 3600.0
        self._client: aiomqtt.Client | None = None
        self.there = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []

    def now_s(self) -> float:
        return time.time() + self._clock_s

    def state(self) -> State:
        return State(
            time_s=self.now_s(), session=self.session, phase=self.phase, reason="", armed=self.armed,
            in_air=self.height_m > 0.1, mode="OFFBOARD", battery=0.8, battery_v=15.9,
            position_w_m=(0.0, 0.0, self.height_m), velocity_w_mps=(0.0, 0.0, 0.0), yaw_rad=0.1, tilt_rad=0.0,
            age_s=0.01, reference_w_m=(0.0, 0.0, 1.0), error_m=0.02, thrust=0.5, controller="etnn", sent_share=0.2,
            faults=(), arms="holding", joints_rad=None, doing=self.doing, late_s=0.0, text="",
        )  # fmt: skip

    async def keep(self) -> None:
        """Connected, and again when that breaks."""
        while True:
            with suppress(aiomqtt.MqttError, ExceptionGroup):
                async with Client("127.0.0.1", self._port, timeout=1.0) as client:
                    await self._serve(client)
            await asyncio.sleep(0.1)

    async def _serve(self, client: aiomqtt.Client) -> None:
        await client.subscribe(self.topics.command, qos=1)
        await client.publish(self.topics.status, self.presence(online=True), qos=1, retain=True)
        self._client = client
        self.there.set()
        async with asyncio.TaskGroup() as group:
            group.create_task(self._show(client))
            intake = Intake(self.session)
            async for message in client.messages:
                assert isinstance(message.payload, bytes)
                read = intake.take(message.payload, self.now_s())
                if isinstance(read, Refusal):
                    self.refusals.append(read)
                    await self._refuse(read)
                    continue
                self.taken.append(read)
                self._tasks.append(asyncio.create_task(self._carry_out(read)))  # broker or not

    async def _refuse(self, refusal: Refusal) -> None:
        reply = Reply(
            id=refusal.id, answer=Answer.REFUSED, time_s=self.now_s(), text=refusal.reason, session=self.session
        )
        await self.publish(self.topics.reply(refusal.reply_to or "nobody"), reply.model_dump_json())

    async def _show(self, client: aiomqtt.Client) -> None:
        while True:
            if not self.silent:
                await client.publish(self.topics.state, self.state().model_dump_json())
            await asyncio.sleep(_PERIOD_S)

    async def _carry_out(self, command: Command) -> None:
        async for answer, text in self._script(self, command):
            data = self.data if answer in {Answer.DONE, Answer.FAILED} else {}
            reply = Reply(id=command.id, answer=answer, time_s=self.now_s(), text=text, session=self.session, data=data)
            assert command.reply_to is not None
            await self.publish(self.topics.reply(command.reply_to), reply.model_dump_json())

    async def publish(self, topic: str, payload: str, retain: bool = False) -> None:
        """Until a broker has it."""
        while True:
            with suppress(aiomqtt.MqttError):
                assert self._client is not None
                return await self._client.publish(topic, payload, qos=1, retain=retain)
            await asyncio.sleep(0.1)

    def presence(self, online: bool) -> str:
        said = Presence(online=online, session=self.session, vehicle=self.topics.vehicle, since_s=self.now_s())
        return said.model_dump_json()

    async def present(self, online: bool) -> None:
        await self.publish(self.topics.status, self.presence(online), retain=True)

    async def tell(self, kind: Kind, text: str, name: str = "") -> None:
        said = Happened(time_s=self.now_s(), kind=kind, text=text, name=name)
        await self.publish(self.topics.event, said.model_dump_json())


@asynccontextmanager
async def scripted(
    port: int, vehicle: str, script: Script = done, session: str = SESSION
) -> AsyncIterator[ScriptedService]:
    """One that runs until the end."""
    service = ScriptedService(port, vehicle, script, session)
    task = asyncio.create_task(service.keep())
    try:
        async with asyncio.timeout(_PATIENCE_S):
            await service.there.wait()
        yield service
    finally:
        for one in [task, *service._tasks]:
            await end(one)
