"""Vehicles of a broker as the page finds, follows and commands them; the broker goes and comes back."""

import asyncio
import gc
import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import aiomqtt
import pytest

from companion.adapters.mqtt.link import BusLink
from companion.adapters.system.background import background
from companion.client.command_draft import CommandDraft
from companion.config.companion_config import load_config
from companion.config.locations import default_config_path
from companion.config.operator_config import OperatorConfig
from companion.page.discovery import Discovery
from companion.page.hub import Hub
from companion.page.outlet import Outlet
from companion.page.vehicles import NotConnectedError, Vehicles
from companion.protocol.about import About
from companion.protocol.telemetry import Answer, Happened, Kind, Presence, State
from companion.service.about import about_of
from tests.adapters.mqtt.rig import SESSION, Vehicle, linked, state, until
from tests.beside import Beside
from tests.broker import broker

DEMO = about_of(load_config(default_config_path("demo.toml")), SESSION)
PRESENCE = Presence(online=True, session=SESSION).model_dump_json().encode()
beside = Beside(at_once=3)


class Finds:
    """Receiver that keeps what is found."""

    def __init__(self) -> None:
        self.vehicles: list[str] = []
        self.abouts: list[tuple[str, About | None]] = []
        self.presences: list[str] = []

    def note_broker(self, linked: bool, why: str = "") -> None:
        """Not of interest here."""

    def note_vehicle(self, name: str) -> None:
        """Keep a name."""
        self.vehicles.append(name)

    def note_about(self, name: str, about: About | None) -> None:
        """Keep a description."""
        self.abouts.append((name, about))

    def note_presence(self, name: str, presence: Presence) -> None:
        """Keep a name."""
        self.presences.append(name if presence.online else "")


def read(discovery: Discovery, topic: str, payload: Any = PRESENCE) -> None:
    discovery._read(aiomqtt.Message(topic, payload, 1, False, 1, None))


def test_any_service_that_says_it_is_there_is_a_vehicle() -> None:
    finds = Finds()
    discovery = Discovery(OperatorConfig(), (), finds)
    for topic in ("dauam/v1/one/status", "dauam/v1/two/status", "dauam/v1/one/status"):
        read(discovery, topic)
    assert finds.presences == ["one", "two", "one"]
    read(discovery, "dauam/v1/one/about", DEMO.model_dump_json().encode())
    read(discovery, "dauam/v1/one/about", b"")
    assert finds.abouts == [("one", DEMO), ("one", None)]


@pytest.mark.parametrize(
    ("topic", "payload"),
    [
        ("dauam/v2/one/status", PRESENCE),
        ("other/v1/one/status", PRESENCE),
        ("dauam/v1/one/state", PRESENCE),
        ("dauam/v1/one/mocap/status", PRESENCE),
        ("dauam/v1/one two/status", PRESENCE),
        (f"dauam/v1/{'x' * 65}/status", PRESENCE),
        ("dauam/v1/one/status", b"nonsense"),
        ("dauam/v1/one/status", None),
    ],
)
def test_what_is_no_presence_of_a_vehicle_is_ignored(topic: str, payload: Any) -> None:
    finds = Finds()
    read(Discovery(OperatorConfig(), (), finds), topic, payload)
    assert (finds.vehicles, finds.presences) == ([], [])


def test_only_those_named_are_shown_and_they_before_they_are_heard() -> None:
    finds = Finds()
    discovery = Discovery(OperatorConfig(), ("one", "two"), finds)
    assert finds.vehicles == ["one", "two"]
    read(discovery, "dauam/v1/three/status")
    assert finds.presences == []
    assert discovery._topics() == [f"dauam/v1/{name}/{end}" for name in ("one", "two") for end in ("status", "about")]


def test_a_thousand_invented_names_are_not_all_believed() -> None:
    finds = Finds()
    discovery = Discovery(OperatorConfig(), (), finds)
    for number in range(1000):
        read(discovery, f"dauam/v1/v{number}/status")
    assert len(set(finds.vehicles)) == 32


class Heard:
    """Messages that a page would get."""

    def __init__(self, outlet: Outlet) -> None:
        self._outlet = outlet
        self.frames: list[dict[str, Any]] = []

    async def run(self) -> None:
        """Take all messages."""
        while True:
            self.frames.append(json.loads(await self._outlet.next()))

    def last(self, kind: str, **fields: object) -> dict[str, Any] | None:
        """Return the newest message of this type with these fields."""
        wanted = {"type": kind, **fields}.items()
        return next((one for one in reversed(self.frames) if one.items() >= wanted), None)


@asynccontextmanager
async def followed(port: int, *only: str) -> AsyncIterator[tuple[Vehicles, Heard]]:
    """Follow the vehicles of a broker, and open a page."""
    hub = Hub(True)
    vehicles = Vehicles(OperatorConfig(port=port), only, hub)
    with hub.page(False) as outlet:
        heard = Heard(outlet)
        async with background(vehicles.run(), "vehicles"), background(heard.run(), "page"):
            yield vehicles, heard


async def show_until_heard(link: BusLink, heard: Heard, shown: State) -> None:
    """Publish a state as a service does, until the page has one."""

    def is_heard() -> object:
        link.show(shown)
        return heard.last("state")

    await until(is_heard)


@pytest.mark.realtime
@beside
async def test_vehicles_are_found_followed_and_commanded() -> None:
    one, two = Vehicle(), Vehicle()
    with broker() as process:
        async with (
            followed(process.port) as (vehicles, heard),
            linked(process.port, one, DEMO, vehicle="one", embedded=True) as link,
            linked(process.port, two, vehicle="two", embedded=True),
        ):
            await until(lambda: heard.last("hello", vehicles=["one", "two"]))
            await until(lambda: heard.last("presence", vehicle="two"))
            await until(lambda: (heard.last("about", vehicle="one") or {}).get("about"))
            joints = state(time.time()).model_copy(update={"joints_rad": (0.1,) * 8})
            await show_until_heard(link, heard, joints)
            said = heard.last("state", vehicle="one")
            assert said is not None
            assert len(said["arms_b_m"]["left"]) == 4
            link.tell(Happened(time_s=1.0, kind=Kind.LOG, text="a door opens"))
            await until(lambda: heard.last("event", vehicle="one"))
            replies = [reply.answer async for reply in vehicles.execute("one", CommandDraft("hold"))]
            assert replies == [Answer.ACCEPTED, Answer.DONE]
    assert ([verb for verb, _ in one.told], two.told) == (["hold"], [])


@pytest.mark.realtime
@beside
async def test_a_broker_that_goes_is_told_and_found_again() -> None:
    with broker() as process:
        async with followed(process.port) as (_, heard), linked(process.port, Vehicle(), embedded=True) as link:
            await until(lambda: heard.last("broker", linked=True))
            await show_until_heard(link, heard, state(time.time()))
            heard.frames.clear()
            process.stop()
            await until(lambda: heard.last("broker", linked=False))
            lost = heard.last("broker", linked=False)
            assert lost is not None
            assert lost["why"].startswith(f"no connection to the broker at mqtt://127.0.0.1:{process.port}: ")
            heard.frames.clear()
            process.start()
            await until(lambda: heard.last("broker", linked=True))
            await show_until_heard(link, heard, state(time.time()))


@pytest.mark.realtime
@beside
async def test_without_a_broker_the_page_says_so_and_sends_nothing() -> None:
    async with followed(1, "one") as (vehicles, heard):
        await until(lambda: (heard.last("broker", linked=False) or {}).get("why", "").endswith("Connection refused"))
        with pytest.raises(NotConnectedError, match="hold: nothing was sent"):
            async for _ in vehicles.execute("one", CommandDraft("hold")):
                pass
        assert heard.last("hello", vehicles=["one"])
        async with asyncio.timeout(2.0):
            await until(lambda: heard.last("beat"))


async def test_the_end_in_the_middle_of_connecting_is_quiet(caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(3):
        async with followed(1):
            await asyncio.sleep(0)  # the connection is being refused in a thread
        gc.collect()
    assert [record.message for record in caplog.records if record.name == "asyncio"] == []
