"""Faults of amqtt that the embedded broker corrects: clients that come, go or fall silent at the same moment."""

import asyncio
import socket
import struct
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

import aiomqtt
import pytest

from companion.client.client import open_console
from companion.client.command_draft import CommandDraft
from companion.client.pending_command import PendingCommand
from companion.config.operator_config import OperatorConfig
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Doing, Reply
from tests.broker import BrokerProcess, broker
from tests.client.scripted import Answers, ScriptedService, scripted
from tests.ports import free_port

pytestmark = pytest.mark.slow

_PATIENCE_S = 30.0
_CONNACK, _PINGREQ, _PINGRESP, _DISCONNECT = b"\x20\x02\x00\x00", b"\xc0\x00", b"\xd0\x00", b"\xe0\x00"
_V5 = aiomqtt.ProtocolVersion.V5


@pytest.fixture(scope="module")
def served() -> Iterator[BrokerProcess]:
    with broker() as process:
        yield process


@asynccontextmanager
async def client(port: int, **options: object) -> AsyncIterator[aiomqtt.Client]:
    async with aiomqtt.Client("127.0.0.1", port, timeout=_PATIENCE_S, **options) as connected:  # type: ignore[arg-type]
        yield connected


async def following(reader: aiomqtt.Client) -> tuple[str, bytes]:
    """Return the next message's topic and payload."""
    message = await asyncio.wait_for(anext(reader.messages), _PATIENCE_S)
    assert isinstance(message.payload, bytes)
    return message.topic.value, message.payload


async def test_fifty_clients_that_connect_at_one_moment_cost_no_command(capfd: pytest.CaptureFixture[str]) -> None:
    tracked = asyncio.Event()

    async def script(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""
        if command.verb == "track":
            service.doing = Doing(id=command.id, verb=command.verb)  # a hold is named by no state
            await tracked.wait()
        yield Answer.DONE, ""

    with broker() as own:
        place = OperatorConfig(port=own.port)

        async def operate(draft: CommandDraft) -> list[Answer]:
            async with open_console(place) as console:
                return [one.answer async for one in PendingCommand(console, draft).messages() if isinstance(one, Reply)]

        async def visit(number: int) -> None:
            async with client(own.port) as visitor:
                await visitor.subscribe("dauam/v1/vehicle/#" if number % 2 else f"x/{number}", qos=1)
                await visitor.publish(f"x/{number}", b"retained", qos=1, retain=True)

        async with scripted(own.port, place.vehicle, script) as service:
            tracking = asyncio.create_task(operate(CommandDraft("track", curve="ellipse")))
            for _ in range(3):
                await asyncio.gather(*(visit(number) for number in range(50)), operate(CommandDraft("hold")))
            tracked.set()
            assert await tracking == [Answer.ACCEPTED, Answer.DONE]
            assert sorted(one.verb for one in service.taken) == ["hold", "hold", "hold", "track"]
    assert capfd.readouterr().err == ""


async def test_a_client_of_mqtt_5_is_told_so_at_once(served: BrokerProcess) -> None:
    with pytest.raises(aiomqtt.MqttError, match="Unsupported protocol version"):
        async with client(served.port, protocol=_V5):
            pass


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\n\r\n", b"\x10\x04\x00\x04MQ", b"\x10\xff\xff\xff\xff\x01"])
async def test_what_is_no_mqtt_is_closed_without_a_traceback(said: bytes, capfd: pytest.CaptureFixture[str]) -> None:
    with broker() as own:
        reader, writer = await asyncio.open_connection("127.0.0.1", own.port)
        writer.write(said)
        writer.write_eof()
        assert await asyncio.wait_for(reader.read(), _PATIENCE_S) == b""
        writer.close()
        async with client(own.port) as other:
            await other.publish("a", b"", qos=1)
    assert capfd.readouterr().err == ""


async def test_a_new_client_hears_what_is_retained_below_its_own_subscriptions_only(served: BrokerProcess) -> None:
    async with client(served.port) as one, client(served.port) as two:
        for topic in ("kept/one", "kept/two"):
            await one.publish(topic, topic.encode(), qos=1, retain=True)
        await one.subscribe("kept/one", qos=1)
        await two.subscribe("kept/two", qos=1)
        await two.subscribe("end", qos=1)
        await one.publish("end", b"", qos=1)
        assert [await following(two) for _ in range(2)] == [("kept/two", b"kept/two"), ("end", b"")]


async def test_what_was_acknowledged_is_passed_on_although_its_sender_leaves_at_once(served: BrokerProcess) -> None:
    async with client(served.port) as reader:
        await reader.subscribe("last/words", qos=1)
        async with client(served.port) as sender:
            await asyncio.gather(*(sender.publish("last/words", b"%d" % number, qos=1) for number in range(20)))
        heard = [(await following(reader))[1] for _ in range(20)]
    assert sorted(heard, key=int) == [b"%d" % number for number in range(20)]


def connect(port: int, keep_alive_s: int, name: bytes = b"quiet") -> socket.socket:
    """Connect a raw client with a last will on `will`; it sends nothing more."""
    fields = [b"MQTT\x04\x06" + struct.pack("!H", keep_alive_s), name, b"will", b"gone"]
    body = b"\x00\x04" + fields[0] + b"".join(struct.pack("!H", len(one)) + one for one in fields[1:])
    wire = socket.create_connection(("127.0.0.1", port))
    wire.sendall(b"\x10" + bytes([len(body)]) + body)
    return wire


async def test_the_last_will_of_a_client_that_falls_silent_or_goes_at_once_is_published(served: BrokerProcess) -> None:
    async with client(served.port) as reader:
        await reader.subscribe("will", qos=1)
        silent = connect(served.port, 1)
        assert await following(reader) == ("will", b"gone")
        silent.close()
        for _ in range(20):
            connect(served.port, 60).close()
            assert await following(reader) == ("will", b"gone")


def ends(wire: socket.socket) -> bool:
    try:
        return wire.recv(100) == b""
    except ConnectionResetError:
        return True


async def test_who_connects_again_under_its_name_takes_the_place_of_its_earlier_connection(
    served: BrokerProcess,
) -> None:
    with connect(served.port, 0, b"same") as earlier:
        earlier.settimeout(_PATIENCE_S)
        assert await asyncio.to_thread(earlier.recv, 100) == _CONNACK
        async with client(served.port, identifier="same") as now:
            assert await asyncio.to_thread(ends, earlier)
            await now.subscribe("to/same", qos=1)
            async with client(served.port) as sender:
                await sender.publish("to/same", b"you", qos=1)
            assert await following(now) == ("to/same", b"you")


async def test_of_two_connections_under_one_name_at_one_moment_one_stays(served: BrokerProcess) -> None:
    for number in range(20):
        wires = []
        for _ in range(2):
            wire = connect(served.port, 0, b"both%d" % number)
            wires.append(await asyncio.open_connection(sock=wire))
        reading = [asyncio.create_task(reader.read(-1)) for reader, _ in wires]
        ended, (stays,) = await asyncio.wait(reading, timeout=_PATIENCE_S, return_when=asyncio.FIRST_COMPLETED)
        assert len(ended) == 1
        _, writer = wires[reading.index(stays)]
        writer.write(_PINGREQ + _DISCONNECT)
        assert (await asyncio.wait_for(stays, _PATIENCE_S)).endswith(_PINGRESP)
        for _, writer in wires:
            writer.close()


def test_the_process_ends_with_its_standard_input() -> None:
    port = free_port()
    child = subprocess.Popen(
        [sys.executable, "-m", "companion.adapters.broker", "127.0.0.1", str(port)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert child.stdout is not None
    assert child.stdin is not None
    assert child.stdout.readline() == b"ready\n"
    child.stdin.close()
    assert child.wait(_PATIENCE_S) == 0
    child.stdout.close()
