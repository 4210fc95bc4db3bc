"""The operator's commands to several vehicles, against services that speak the bus over a real broker."""

import asyncio
import io
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from companion.cli.complete import vehicles
from companion.cli.operator.exit_codes import worst
from companion.cli.operator.panel import panels
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Doing, Kind, Presence, State
from tests.broker import BrokerProcess, broker
from tests.client.scripted import Answers, ScriptedService, scripted
from tests.flights.command import Ran, run, start

pytestmark = pytest.mark.slow

Two = tuple[ScriptedService, ScriptedService, tuple[str, ...]]


@pytest.fixture
def there() -> Iterator[BrokerProcess]:
    with broker() as process:
        yield process


class Flights:
    """Script of all vehicles: notes when commands begin and end; `refuses` and `fails` name vehicles."""

    def __init__(self) -> None:
        self.refuses = self.fails = self.waits = ""
        self.log: list[str] = []
        self.over = asyncio.Event()

    async def __call__(self, service: ScriptedService, command: Command) -> Answers:
        name = service.topics.vehicle
        self.log.append(f"{name} {command.verb}")
        if name == self.refuses:
            yield Answer.REFUSED, "the vehicle is not in the air"
            return
        yield Answer.ACCEPTED, f"{command.verb} begins"
        if command.verb == self.waits:
            service.doing = Doing(id=command.id, verb=command.verb)
            await self.over.wait()
        elif command.verb in {"hold", "abort"}:
            self.over.set()
        await asyncio.sleep(0.1)
        self.log.append(f"{name} {command.verb} ends")
        yield (Answer.FAILED, "it tipped over") if name == self.fails else (Answer.DONE, f"{command.verb} is done")


@asynccontextmanager
async def two(there: BrokerProcess, flights: Flights) -> AsyncIterator[Two]:
    async with scripted(there.port, "d-1", flights) as one, scripted(there.port, "d-2", flights, "f" * 16) as other:
        yield one, other, ("--broker", f"mqtt://127.0.0.1:{there.port}", "--vehicle")


def objects(ran: Ran) -> list[dict[str, Any]]:
    return [json.loads(line) for line in ran.out.splitlines()]


async def test_stopping_goes_to_all_at_once_and_moving_to_one_after_the_other(there: BrokerProcess) -> None:
    flights = Flights()
    async with two(there, flights) as (_, _, where):
        land = await run("land", *where, "all")
        takeoff = await run("takeoff", *where, "d-2,d-1")
        hold = await run("hold", "--one-by-one", *where, "d-1,d-2")
    assert (land.code, takeoff.code, hold.code) == (0, 0, 0)
    begin, orderly = flights.log[:4], flights.log[4:]
    assert sorted(begin[:2]) == ["d-1 land", "d-2 land"]
    assert orderly == [
        "d-2 takeoff", "d-2 takeoff ends", "d-1 takeoff", "d-1 takeoff ends",
        "d-1 hold", "d-1 hold ends", "d-2 hold", "d-2 hold ends",
    ]  # fmt: skip
    assert takeoff.out.splitlines() == [
        "  d-2: takeoff begins",
        "d-2: takeoff is done",
        "  d-1: takeoff begins",
        "d-1: takeoff is done",
    ]


async def test_one_after_the_other_stops_at_the_first_failure(there: BrokerProcess) -> None:
    flights = Flights()
    flights.fails = "d-1"
    async with two(there, flights) as (_, _, where):
        arm = await run("arm", *where, "d-1,d-2")
    assert arm.code == 1
    assert flights.log == ["d-1 arm", "d-1 arm ends"]
    assert arm.err.splitlines() == [
        "companion: d-1: arm failed: it tipped over",
        "companion: d-2: arm was not sent, because it has not succeeded on d-1",
        "companion: arm: 0 of 2 vehicles",
    ]


async def test_the_exit_code_is_the_worst_and_json_names_the_vehicle(there: BrokerProcess) -> None:
    flights = Flights()
    flights.refuses = "d-2"
    async with two(there, flights) as (_, _, where):
        ran = await run("hold", "--json", *where, "all")
    assert (ran.code, ran.err) == (2, "")
    said = objects(ran)
    assert [(one["answer"]) for one in said if one.get("vehicle") == "d-1" and one["type"] == "reply"] == [
        "accepted",
        "done",
    ]
    ends = {one.get("vehicle", ""): one["code"] for one in said if one["type"] == "end"}
    assert ends == {"d-1": 0, "d-2": 2, "": 2}
    assert said[-1] == {"type": "end", "code": 2, "text": "hold: 1 of 2 vehicles"}


async def test_a_vehicle_that_is_not_there_keeps_nobody_from_stopping_but_others_from_moving(
    there: BrokerProcess,
) -> None:
    flights = Flights()
    async with two(there, flights) as (_, _, where):
        hold = await run("hold", *where, "d-1,gone,d-2")
        takeoff = await run("takeoff", *where, "d-1,gone")
    assert (hold.code, takeoff.code) == (3, 3)
    assert sorted(flights.log) == ["d-1 hold", "d-1 hold ends", "d-2 hold", "d-2 hold ends"]
    assert "companion: gone: no service of 'gone' at" in hold.err
    assert "companion: d-1: takeoff was not sent, because gone cannot be reached" in takeoff.err


async def test_ctrl_c_makes_all_of_them_safe(there: BrokerProcess) -> None:
    flights = Flights()
    flights.waits = "takeoff"
    async with two(there, flights) as (one, other, where):
        running = await start("takeoff", "--together", *where, "all")
        for _ in range(2):
            await running.until_line("takeoff begins")
        running.interrupt()
        ran = await running.ended()
    assert ran.code == 130
    for service, name in ((one, "d-1"), (other, "d-2")):
        assert [command.verb for command in service.taken] == ["takeoff", "hold"]
        assert f"companion: {name}: interrupted; hold done: hold is done" in ran.err


@pytest.mark.parametrize("words", [("goto", "0", "0", "1"), ("track", "ellipse")])
async def test_several_vehicles_are_not_led_to_one_place(words: tuple[str, ...]) -> None:
    ran = await run(*words, "--vehicle", "a,b")
    assert ran.code == 2
    assert ran.err.startswith(f"companion: {words[0]} would lead several vehicles to the same place: name one vehicle")


async def test_a_vehicle_that_is_not_there_is_answered_with_those_that_are(there: BrokerProcess) -> None:
    async with two(there, Flights()) as (_, _, where):
        ran = await run("hold", *where, "vehicle")
    assert ran.code == 3
    assert ran.err.endswith("vehicle's computer; online there: d-1, d-2 (--vehicle NAME, or all)\n")


async def test_all_that_are_none_is_one_sentence(there: BrokerProcess) -> None:
    ran = await run("land", "--broker", f"mqtt://127.0.0.1:{there.port}", "--vehicle", "all")
    assert (ran.code, ran.out) == (3, "")
    assert ran.err.startswith("companion: no vehicle is online at mqtt://127.0.0.1")


async def test_the_states_of_all_and_the_names_for_completion(there: BrokerProcess) -> None:
    async with two(there, Flights()) as (one, other, where):
        one.phase, other.phase = "hold", "land"
        once = await run("status", *where, "all")
        lines = await run("status", "--once", "--json", *where, "d-1,gone,d-2")
        context = SimpleNamespace(params={"broker": where[1]})
        found = [await asyncio.to_thread(vehicles, context, typed) for typed in ("", "d-1,", "d-1,d", "x")]
        watching = await start("watch", *where, "all")
        await watching.until_line("d-2: the service runs")
        await other.tell(Kind.FAULT, "the pose is old", "mocap late")
        await watching.until_line("d-2: fault: mocap late: the pose is old")
        watching.interrupt()
        await watching.ended()
    assert once.out.splitlines()[0].split() == ["d-1", "d-2"]
    assert once.out.splitlines()[1].split() == ["phase", "hold", "land"]
    assert lines.code == 3
    assert {(line["type"], line["vehicle"], line.get("phase", "")) for line in objects(lines)} >= {
        ("state", "d-1", "hold"),
        ("state", "d-2", "land"),
        ("end", "gone", ""),
    }
    assert found == [["d-1", "d-2", "all"], ["d-1,d-1", "d-1,d-2"], ["d-1,d-1", "d-1,d-2"], []]


def test_names_are_not_completed_without_a_broker() -> None:
    assert vehicles(SimpleNamespace(params={"broker": "mqtt://127.0.0.1:9"}), "d") == []


def test_the_worst_code_is_what_is_least_known() -> None:
    assert [worst(codes) for codes in ((), (0, 2), (2, 3), (3, 1), (1, 4), (4, 130))] == [0, 2, 3, 1, 4, 130]


def test_each_vehicle_has_its_column_and_what_is_wrong_is_below_each() -> None:
    states = (
        State(time_s=0.0, session="a", phase="hold", faults=("mocap late", "battery low"), battery=0.5),
        State(time_s=0.0, session="b", phase="land", warnings=("not recorded",), arms="holding"),
    )
    consoles: list[Any] = [
        SimpleNamespace(
            vehicle=name, state=state, presence=Presence(online=True, session="a"), linked=True,
            state_age_s=lambda age_s=age_s: age_s, state_waited_s=lambda: 0.0,
        )
        for name, state, age_s in zip(("one", "two"), states, (0.1, 3.0), strict=True)
    ]  # fmt: skip
    out = Console(file=io.StringIO(), width=100)
    out.print(panels(consoles))
    assert isinstance(out.file, io.StringIO)
    shown = [" ".join(line.split()) for line in out.file.getvalue().splitlines()]
    assert shown[:3] == ["one two", "link nothing heard for 3 s", "phase hold land"]
    assert shown[3:] == [
        "vehicle disarmed disarmed", "arms holding", "battery 50%", "fault mocap late", "battery low",
        "warning not recorded",
    ]  # fmt: skip
