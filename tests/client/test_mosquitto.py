"""The operator's client over MQTT 5, against the real mosquitto, as from another computer."""

import asyncio
import getpass
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from companion.client.client import open_console
from companion.client.command_draft import CommandDraft
from companion.client.messages import Link
from companion.client.pending_command import PendingCommand
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import ConfigError
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Reply
from tests.client.scripted import Answers, ScriptedService, scripted
from tests.mosquitto import mosquitto, needs_mosquitto

pytestmark = needs_mosquitto
_FAR = "127.0.0.2"
"""Not where an embedded broker would be."""


class Network:
    """Between an operator and the broker."""

    def __init__(self, to_port: int) -> None:
        self._to_port = to_port
        self._writers: list[asyncio.StreamWriter] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self.there = True

    async def carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if not self.there:
            return writer.close()
        onward, back = await asyncio.open_connection("127.0.0.1", self._to_port)
        self._writers += [writer, back]
        for source, sink in ((reader, back), (onward, writer)):
            self._tasks.add(asyncio.create_task(self._pump(source, sink)))
        return None

    async def _pump(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        while data := await source.read(65536):
            sink.write(data)
        sink.close()

    def cut(self) -> None:
        self.there = False
        for writer in self._writers:
            writer.transport.abort()

    async def end(self) -> None:
        self.cut()
        await asyncio.gather(*self._tasks, return_exceptions=True)


@asynccontextmanager
async def network(to_port: int) -> AsyncIterator[tuple[Network, OperatorConfig]]:
    carrying = Network(to_port)
    server = await asyncio.start_server(carrying.carry, _FAR, 0)
    try:
        yield carrying, OperatorConfig(host=_FAR, port=server.sockets[0].getsockname()[1], vehicle="far")
    finally:
        server.close()
        await carrying.end()


async def test_what_is_answered_while_the_network_is_gone_is_kept_for_us(tmp_path: Path) -> None:
    async def ends_unheard(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""
        await gone.wait()
        yield Answer.DONE, "it hovers"
        answered.set()

    gone, answered = asyncio.Event(), asyncio.Event()
    with mosquitto(tmp_path, "allow_anonymous true") as port:
        async with (
            network(port) as (carrying, place),
            scripted(port, "far", ends_unheard) as service,
            open_console(place) as console,
        ):
            said: list[object] = []
            async for one in PendingCommand(console, CommandDraft("takeoff")).messages():
                said.append(one)
                if isinstance(one, Reply) and one.answer is Answer.ACCEPTED:
                    carrying.cut()
                    gone.set()
                    await answered.wait()
                    carrying.there = True
    assert [one.there for one in said if isinstance(one, Link)] == [False, True]
    assert [one.answer for one in said if isinstance(one, Reply)] == [Answer.ACCEPTED, Answer.DONE]
    assert len(service.taken) == 1


async def test_who_may_only_look_is_told_so(tmp_path: Path) -> None:
    acl = tmp_path / "acl"
    acl.write_text("topic read #\n" + "".join(f"topic write dauam/v1/+/{one}\n" for one in ("state", "status")))
    acl.chmod(0o600)
    with mosquitto(tmp_path, "allow_anonymous true", f"acl_file {acl}", f"user {getpass.getuser()}") as port:
        async with network(port) as (_, place), scripted(port, "far"), open_console(place) as console:
            with pytest.raises(ConfigError, match="does not let us command: not authorized"):
                _ = [one async for one in PendingCommand(console, CommandDraft("arm")).messages()]


async def test_who_is_not_let_in_is_told_what_to_give(tmp_path: Path) -> None:
    with mosquitto(tmp_path, "allow_anonymous false") as port:
        async with network(port) as (_, place):
            with pytest.raises(
                ConfigError, match=r"rejects the connection: give --broker mqtt://USER@HOST and --password"
            ):
                async with open_console(place):
                    pass
