"""Access control of a real mosquitto with passwords, an ACL and TLS: messages of unauthorized clients have no effect.

Figures: docs/bus.md.
"""

import asyncio
import json
import shutil
import ssl
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from hypothesis import Phase, given, settings

from companion.adapters.mqtt.link import BusLink
from companion.core.interfaces import ConfigError
from tests.adapters.mqtt.rig import TOPICS, V5, Operator, Vehicle, command, linked, operating, until
from tests.mosquitto import mosquitto, needs_mosquitto
from tests.protocol.payloads import bad_payloads

pytestmark = [pytest.mark.realtime, needs_mosquitto]

USERS = ("vehicle", "operator", "guest", "neighbour")
ACL = f"""
user vehicle
topic readwrite {TOPICS.root}/#

user operator
topic write {TOPICS.command}
topic read {TOPICS.root}/#

user guest
topic read {TOPICS.root}/#

user neighbour
topic readwrite dauam/v1/other/#
"""
OVER_THE_BROKER = 30
"""Times ten malformed payloads."""


@dataclass(frozen=True)
class Lab:
    """A broker that lets in whom it knows."""

    port: int
    folder: Path

    @asynccontextmanager
    async def link(self, vehicle: Vehicle, **changes: Any) -> AsyncIterator[BusLink]:
        config = {"user": "vehicle", "password_file": str(self.folder / "password")} | changes
        async with linked(self.port, vehicle, **config) as link:
            yield link

    @asynccontextmanager
    async def flying(self, vehicle: Vehicle) -> AsyncIterator[Operator]:
        """The link there, and an operator who may command."""
        async with self.link(vehicle) as link:
            await until(lambda: link.age_s() == 0.0)
            async with operating(self.port, V5, username="operator", password="of operator") as operator:
                yield operator

    def client(self, user: str | None, password: str | None = None) -> aiomqtt.Client:
        return aiomqtt.Client("127.0.0.1", self.port, username=user, password=password, protocol=V5, timeout=2.0)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("mosquitto")
    program = shutil.which("mosquitto_passwd")
    assert program is not None
    (folder / "users").touch(0o600)
    for user in USERS:
        subprocess.run([program, "-b", str(folder / "users"), user, f"of {user}"], check=True)
    (folder / "acl").write_text(ACL)
    password = folder / "password"
    password.touch(0o600)
    password.write_text("of vehicle\n")
    lines = (
        "allow_anonymous false",
        f"password_file {folder}/users",
        f"acl_file {folder}/acl",
        "user root",
        "set_tcp_nodelay true",
    )
    with mosquitto(folder, *lines) as port:
        yield Lab(port, folder)


async def test_who_is_known_may_command(lab: Lab) -> None:
    vehicle = Vehicle()
    async with lab.flying(vehicle) as operator:
        await operator.hears(TOPICS.status, online=True)
        name = await operator.order("land", reply_to="operator")
        for answer in ("accepted", "done"):
            await operator.hears(TOPICS.reply("operator"), id=name, answer=answer)
        assert vehicle.told == [("land", name)]


@pytest.mark.parametrize(
    ("user", "password"),
    [(None, None), ("operator", None), ("operator", ""), ("operator", "of vehicle"), ("Operator", "of operator")],
)
async def test_without_credentials_nobody_gets_so_far_as_to_command(
    user: str | None, password: str | None, lab: Lab
) -> None:
    with pytest.raises(aiomqtt.MqttError, match=r"Not authorized|Bad user name or password"):
        async with lab.client(user, password):
            pass


@pytest.mark.parametrize("user", ["guest", "neighbour"])
async def test_who_may_not_command_is_refused_by_the_broker(user: str, lab: Lab) -> None:
    vehicle = Vehicle()
    async with lab.flying(vehicle) as operator:
        async with lab.client(user, f"of {user}") as stranger:
            for number in range(20):
                await stranger.publish(TOPICS.command, command("kill", f"{number}", confirm="kill"), qos=1)
                await stranger.publish(TOPICS.status, json.dumps({"online": False}), qos=1, retain=True)
        await operator.order("hold", id="mine")
        await until(lambda: vehicle.commands)
        assert vehicle.told == [("hold", "mine")]
        assert not any(said.topic == TOPICS.status and not said.json["online"] for said in operator.heard)


async def test_commands_on_topics_beside_the_vehicles_own_are_not_read(lab: Lab) -> None:
    vehicle = Vehicle()
    beside = (
        "dauam/v1/other/command", "dauam/v2/vehicle/command", "dauam/vehicle/command", "dauam/v1/vehicle/command/x",
        "dauam/v1/vehicle/Command", "dauam/v1/vehicle", "/dauam/v1/vehicle/command", TOPICS.state, TOPICS.event,
    )  # fmt: skip
    async with lab.flying(vehicle) as operator:
        async with lab.client("vehicle", "of vehicle") as mighty, lab.client("neighbour", "of neighbour") as neighbour:
            for number, topic in enumerate(beside):
                await mighty.publish(topic, command("land", f"{number}"), qos=1)
                await neighbour.publish(topic, command("land", f"n{number}"), qos=1)
        await operator.order("hold", id="mine")
        await until(lambda: vehicle.commands)
        assert vehicle.told == [("hold", "mine")]


async def test_what_was_recorded_is_refused_whenever_it_is_sent_again(lab: Lab) -> None:
    vehicle, later = Vehicle(), Vehicle()
    recorded = [command("land", f"r{number}", reply_to="me") for number in range(20)]
    async with lab.flying(vehicle) as operator:
        for said in recorded * 2:
            await operator.say(said)
        for number in range(20):
            said = (await operator.hears(TOPICS.reply("me"), id=f"r{number}", answer="refused")).json["text"]
            assert said == "this id was taken already"
        for number in range(20):
            await operator.say(command("land", f"s{number}", reply_to="me", session="f" * 16))
            refused = (await operator.hears(TOPICS.reply("me"), id=f"s{number}", answer="refused")).json["text"]
            assert "another run" in refused
            await operator.say(command("land", f"o{number}", reply_to="me", sent_s=time.time() - 6.0))
            refused = (await operator.hears(TOPICS.reply("me"), id=f"o{number}", answer="refused")).json["text"]
            assert refused.startswith("sent 6")
    assert len(vehicle.commands) == 20
    assert later.commands == []


def test_malformed_payloads_over_the_broker_are_refused_each_with_a_reason(lab: Lab) -> None:
    payloads: list[list[bytes]] = []

    @settings(max_examples=OVER_THE_BROKER, phases=[Phase.generate])
    @given(bad_payloads())
    def collect(drawn: list[bytes]) -> None:
        payloads.append(drawn)

    collect()
    asyncio.run(_all_refused(lab, payloads))
    print(f"malformed payloads over mosquitto refused: {sum(map(len, payloads))}")
    assert sum(map(len, payloads)) >= 300


async def _all_refused(lab: Lab, payloads: list[list[bytes]]) -> None:
    """Ten at a time: what is refused in a flood is told in part only."""
    vehicle = Vehicle()
    async with lab.flying(vehicle) as operator:
        for some in payloads:
            for payload in some:
                await operator.say(payload)
            await until(lambda: sum(_refusal(said.payload) for said in operator.heard) == len(some))  # noqa: B023
            operator.heard.clear()
    assert vehicle.commands == []


def _refusal(payload: bytes) -> bool:
    said = json.loads(payload)
    answer = said.get("answer") or (said.get("name") if said.get("kind") == "reply" else None)
    return answer == "refused" and bool(said["text"])


async def test_the_service_says_what_is_wrong_with_its_password(lab: Lab, caplog: pytest.LogCaptureFixture) -> None:
    wrong = lab.folder / "wrong"
    wrong.touch(0o600)
    wrong.write_text("of nobody")
    async with lab.link(Vehicle(), password_file=str(wrong)) as link:
        await until(lambda: "Not authorized" in caplog.text)
        assert link.age_s() > 0.0


async def test_the_service_says_when_the_broker_passes_on_nothing_that_it_says(
    lab: Lab, caplog: pytest.LogCaptureFixture
) -> None:
    mine = lab.folder / "of_operator"
    mine.touch(0o600)
    mine.write_text("of operator")
    async with lab.link(Vehicle(), user="operator", password_file=str(mine)):
        await until(lambda: "does not forward dauam/v1/vehicle/...: Not authorized" in caplog.text)


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("tls")
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=lab",
         "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(folder / "key.pem"), "-out", str(folder / "ca.pem")],
        check=True, capture_output=True,
    )  # fmt: skip
    lines = (
        f"certfile {folder}/ca.pem",
        f"keyfile {folder}/key.pem",
        "allow_anonymous true",
        "user root",
        "set_tcp_nodelay true",
    )
    with mosquitto(folder, *lines) as port:
        yield Lab(port, folder)


async def test_over_tls_a_command_comes_through(tls: Lab) -> None:
    vehicle, ca = Vehicle(), str(tls.folder / "ca.pem")
    async with linked(tls.port, vehicle, tls=True, ca_file=ca) as link:
        await until(lambda: link.age_s() == 0.0)
        trusted = ssl.create_default_context(cafile=ca)
        async with operating(tls.port, V5, tls_context=trusted) as operator:
            name = await operator.order("land", reply_to="me")
            await operator.hears(TOPICS.reply("me"), id=name, answer="done")
    assert vehicle.told == [("land", name)]


async def test_a_broker_whose_certificate_nobody_vouches_for_is_not_spoken_to(
    tls: Lab, caplog: pytest.LogCaptureFixture
) -> None:
    async with linked(tls.port, Vehicle(), tls=True) as link:
        await until(lambda: "certificate verify failed" in caplog.text)
        assert link.age_s() > 0.0


async def test_a_file_that_holds_no_certificate_is_told_before_anything_flies(tls: Lab) -> None:
    with pytest.raises(ConfigError, match=r"^operator\.ca_file = .*: no certificates can be read"):
        async with linked(tls.port, Vehicle(), tls=True, ca_file=str(tls.folder / "key.pem")):
            pass
