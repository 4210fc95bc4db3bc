"""The example files of config/mosquitto/ on the real mosquitto: who gets in, and who may say and read what."""

import asyncio
import getpass
import re
import ssl
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import aiomqtt
import pytest

from companion.adapters.mqtt.link import BusLink
from companion.client.client import open_console
from companion.client.command_draft import CommandDraft
from companion.client.errors import NoServiceError
from companion.client.pending_command import PendingCommand
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import ConfigError
from companion.protocol.telemetry import Answer, Reply, State
from companion.protocol.topics import Topics
from tests.adapters.mqtt.rig import CLOCK, SESSION, V5, Vehicle, until
from tests.mosquitto import EXAMPLES, FAR, USERS, Lab, lab, make_certificates, mosquitto, needs_mosquitto
from tests.packages import needs
from tests.units.tools import said

pytestmark = [needs_mosquitto, pytest.mark.slow]

TOPICS = {name: Topics("dauam", name) for name in ("dauam-1", "dauam-2")}
PARTS = ("command", "state", "event", "status", "about", "intent", "mocap", "mocap/bridge", "reply/anna-1")
MAY_SAY = {
    "dauam-1": {f"dauam-1/{part}" for part in ("state", "event", "status", "about", "intent", "reply/anna-1")},
    "dauam-2": {f"dauam-2/{part}" for part in ("state", "event", "status", "about", "intent", "reply/anna-1")},
    "anna": {"dauam-1/command"},
    "ben": {"dauam-1/command", "dauam-2/command"},
    "screen": set(),
    "mocap-bridge": {f"{name}/{part}" for name in TOPICS for part in ("mocap", "mocap/bridge")},
}
SAID = set().union(*MAY_SAY.values())
"""All topics: each is somebody's."""
ALL_READ = {f"{name}/{part}" for name in TOPICS for part in ("status", "intent")}
"""What vehicles must know of each other; a pattern of mosquitto's is for all users."""
MAY_READ = {
    "dauam-1": {"dauam-1/command", "dauam-1/mocap", "dauam-1/mocap/bridge"} | ALL_READ,
    "dauam-2": {"dauam-2/command", "dauam-2/mocap", "dauam-2/mocap/bridge"} | ALL_READ,
    "anna": {topic for topic in SAID if topic.startswith("dauam-1/")} | ALL_READ,
    "ben": SAID,
    "screen": {topic for topic in SAID if topic.endswith(("/state", "/event", "/about"))} | ALL_READ,
    "mocap-bridge": {"dauam-1/mocap/bridge", "dauam-2/mocap/bridge"} | ALL_READ,
}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with lab(tmp_path_factory.mktemp("lab")) as there:
        yield there


@asynccontextmanager
async def serving(place: OperatorConfig, vehicle: Vehicle) -> AsyncIterator[None]:
    """The service's end of the bus, connected."""
    link = BusLink(place, CLOCK, SESSION)
    async with link.listening(vehicle.on_command):

        async def show() -> None:
            while True:
                link.show(State(time_s=time.time(), session=SESSION, phase="standby"))
                await asyncio.sleep(0.05)

        showing = asyncio.create_task(show(), name="state")
        try:
            await until(lambda: link.age_s() == 0.0)
            yield
        finally:
            showing.cancel()
            await asyncio.wait([showing])


@asynccontextmanager
async def speaking(room: Lab, user: str) -> AsyncIterator[aiomqtt.Client]:
    trusted = ssl.create_default_context(cafile=str(room.ca_file))
    async with aiomqtt.Client(
        FAR, room.broker.port, username=user, password=f"of {user}", tls_context=trusted, protocol=V5
    ) as client:
        yield client
    await asyncio.sleep(0.01)  # its own last task ends a little later


async def test_service_and_operator_meet_by_tls_password_and_mqtt_5(room: Lab) -> None:
    vehicle = Vehicle()
    async with serving(room.place("dauam-1"), vehicle), open_console(room.place("anna")) as console:
        said = [one async for one in PendingCommand(console, CommandDraft("land")).messages()]
    await until(lambda: re.search(r"Client console-\w+ disconnected", room.log))  # and the broker keeps nothing for it
    assert [one.answer for one in said if isinstance(one, Reply)] == [Answer.ACCEPTED, Answer.DONE]
    assert [verb for verb, _ in vehicle.told] == ["land"]
    for user in ("dauam-1", "anna"):
        assert any("(p5," in line and f"u'{user}'" in line for line in room.log.splitlines()), "MQTT 5"


async def test_each_says_and_reads_what_is_its_own_and_nothing_else(room: Lab) -> None:
    heard: dict[str, set[tuple[str, str]]] = {user: set() for user in USERS}
    async with AsyncExitStack() as stack:
        clients = {user: await stack.enter_async_context(speaking(room, user)) for user in USERS}
        for client in clients.values():
            await client.subscribe("#", qos=0)
        for user, client in clients.items():
            for name, topics in TOPICS.items():
                for part in PARTS:
                    await client.publish(f"{topics.root}/{part}", f"{user} {name}", qos=1)
        for user, client in clients.items():
            await client.subscribe("barrier", qos=0)  # answered after all that was to be heard
            while len(client.messages):
                message = await anext(client.messages)
                assert isinstance(message.payload, bytes)
                topic = message.topic.value.removeprefix("dauam/v1/")
                heard[user].add((message.payload.decode().split()[0], topic))
    said = {user: {topic for by, topic in heard["ben"] if by == user} for user in USERS}
    assert said == MAY_SAY
    assert {user: {topic for _, topic in topics} for user, topics in heard.items()} == MAY_READ


@pytest.mark.parametrize("verb", ["kill", "land"])
async def test_a_stranger_commands_nothing(room: Lab, verb: str) -> None:
    vehicle = Vehicle()
    confirm = {"confirm": "kill"} if verb == "kill" else {}
    async with serving(room.place("dauam-1"), vehicle):
        for user in ("dauam-2", "screen", "mocap-bridge"):
            async with speaking(room, user) as client:
                payload = CommandDraft(verb, **confirm).payload(SESSION, time.time(), "me")
                await client.publish(TOPICS["dauam-1"].command, payload, qos=1)
        async with open_console(room.place("screen")) as looking:
            with pytest.raises(ConfigError, match="does not let us command: not authorized"):
                _ = [one async for one in PendingCommand(looking, CommandDraft(verb, **confirm)).messages()]
    assert vehicle.commands == []


async def test_who_does_not_belong_here_does_not_get_in(room: Lab, tmp_path: Path) -> None:
    anna = room.place("anna")
    wrong = tmp_path / "password"
    wrong.touch(0o600)
    wrong.write_text("guessed")
    make_certificates(tmp_path / "other", FAR)
    for changed, kind, why in (
        ({"password_file": str(wrong)}, ConfigError, "rejects the connection: "),
        ({"user": "nobody"}, ConfigError, "rejects the connection: "),
        ({"user": None, "password_file": None}, ConfigError, "rejects the connection: "),
        ({"tls": False, "ca_file": None}, NoServiceError, "the broker at mqtt://.* does not answer"),
        ({"ca_file": str(tmp_path / "other/ca.crt")}, ConfigError, "is the CA file .* the one that signed"),
        ({"ca_file": None}, ConfigError, "is the CA file .* the one that signed"),
    ):
        place = OperatorConfig.model_validate(anna.model_dump() | changed)
        with pytest.raises(kind, match=why):
            async with open_console(place):
                pass


async def test_a_broker_by_another_name_than_its_certificate_says_is_not_trusted(tmp_path: Path) -> None:
    make_certificates(tmp_path, "192.168.0.10", "broker.lab")
    before = (tmp_path / "ca.crt").read_bytes()
    lines = (f"certfile {tmp_path}/server.crt", f"keyfile {tmp_path}/server.key", f"user {getpass.getuser()}")
    with mosquitto(tmp_path, "allow_anonymous true", *lines) as port:
        place = OperatorConfig(port=port, tls=True, ca_file=str(tmp_path / "ca.crt"))
        with pytest.raises(ConfigError, match=r"not valid for '127\.0\.0\.1'"):
            async with open_console(place):
                pass
    make_certificates(tmp_path, "127.0.0.1")
    assert (tmp_path / "ca.crt").read_bytes() == before, "clients need nothing new"
    with mosquitto(tmp_path, "allow_anonymous true", *lines) as port:
        async with open_console(place.model_copy(update={"port": port})) as console:
            assert console.linked


@needs("shellcheck")
def test_the_script_is_sound() -> None:
    said("shellcheck", EXAMPLES / "make-certificates.sh")


def test_the_script_says_what_it_wants(tmp_path: Path) -> None:
    assert "say: make-certificates.sh FOLDER NAME..." in said(EXAMPLES / "make-certificates.sh", tmp_path, code=2)
    wrong = said(EXAMPLES / "make-certificates.sh", tmp_path / "new", "broker.lab", "DNS:other,IP:1.2.3.4", code=2)
    assert "'DNS:other,IP:1.2.3.4' is no name or address of a computer" in wrong
    assert not (tmp_path / "new").exists()
