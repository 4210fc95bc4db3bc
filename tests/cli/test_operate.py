"""The operator's commands as processes, against a service that speaks the bus over a real broker."""

import asyncio
import itertools
import json
import signal
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from companion.core.waypoint_limits import MAX_WAYPOINTS
from companion.protocol.commands import Arms, Command, Track
from companion.protocol.telemetry import Answer, Doing
from tests.broker import BrokerProcess, broker
from tests.cli.typed import typing
from tests.client.scripted import Answers, ScriptedService, scripted
from tests.flights.command import Ran, run, start

pytestmark = pytest.mark.slow

_NUMBER = itertools.count()
_SLOW = frozenset({"arm", "takeoff", "goto", "track", "land"})


@pytest.fixture(scope="module")
def there() -> Iterator[BrokerProcess]:
    with broker() as process:
        yield process


class Flight:
    """A service that carries slow verbs out until something ends them."""

    def __init__(self) -> None:
        self.over = asyncio.Event()
        self.grounded = False

    async def __call__(self, service: ScriptedService, command: Command) -> Answers:
        if command.verb == "resume":
            yield Answer.REFUSED, "this service has the vehicle; there is nothing to take back"
        elif command.verb == "hold" and self.grounded:
            yield Answer.REFUSED, "the vehicle is not in the air"
        elif command.verb == "controller":
            yield Answer.ACCEPTED, ""
            yield Answer.FAILED, "it cannot be read"
        else:
            yield Answer.ACCEPTED, f"{command.verb} begins"
            if command.verb in _SLOW:
                service.doing = Doing(id=command.id, verb=command.verb)
                await self.over.wait()
            else:
                self.over.set()
            yield Answer.DONE, f"{command.verb} is done"


@asynccontextmanager
async def serving(there: BrokerProcess) -> AsyncIterator[tuple[ScriptedService, Flight, tuple[str, ...]]]:
    """Service, flight, and the options that lead to them."""
    vehicle, flight = f"c{next(_NUMBER)}", Flight()
    async with scripted(there.port, vehicle, flight) as service:
        yield service, flight, ("--broker", f"mqtt://127.0.0.1:{there.port}", "--vehicle", vehicle)


def objects(ran: Ran) -> list[dict[str, Any]]:
    return [json.loads(line) for line in ran.out.splitlines()]


async def test_exit_codes_say_how_it_ended(there: BrokerProcess) -> None:
    async with serving(there) as (service, _, where), serving(there) as (_, _, slow):
        wanted = {
            ("hold", *where): 0,
            ("controller", "mine", *where): 1,
            ("resume", *where): 2,
            ("land", "--no-wait", *slow): 0,
            ("land", "--timeout", "0.3", *slow): 4,
            ("disarm", *where, "--vehicle", "nobody"): 3,
        }
        ran = [await run(*words) for words in wanted]
    assert {words: one.code for words, one in zip(wanted, ran, strict=True)} == wanted
    assert [len(one.err.splitlines()) for one in ran] == [0, 1, 1, 0, 1, 1]
    assert ran[2].err == "companion: resume rejected: this service has the vehicle; there is nothing to take back\n"
    assert sorted(one.verb for one in service.taken) == ["controller", "hold", "resume"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("goto", "-1.5", "nan", "1"), "companion: goto: y_m = nan: must be a finite number\n"),
        (("takeoff", "--height", "80"), "companion: takeoff: height_m = 80.0: must be at most"),
        (("kill",), "companion: kill stops the motors in the air: without a terminal to confirm at, add"),
        (("track", "elipse"), "companion: unknown trajectory 'elipse': give ellipse or figure8, or a CSV file"),
        (
            ("track", "a.csv", "--laps", "3"),
            "companion: --laps is only for ellipse and figure8: a.csv defines",
        ),
        (("hold", "--broker", "near:99999"), "companion: --broker 'near:99999': Port out of range 0-65535: give mqtt:"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_sent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], says: str
) -> None:
    typed = typing(words[0], monkeypatch, capsys)(*words[1:])
    assert (typed.code, typed.out, typed.err[: len(says)]) == (2, "", says)


def test_a_wrong_word_is_met_with_the_right_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for word, meant in (("takeof", "takeoff"), ("contoller", "controller"), ("figure", "")):
        typed = typing(word, monkeypatch, capsys)()
        assert typed.code == 2
        assert (f"Did you mean '{meant}'?" in typed.err) == bool(meant)


@pytest.mark.parametrize(
    ("words", "sent", "says"),
    [
        (("arm",), ["arm", "abort"], "interrupted; abort done: abort is done"),
        (("takeoff",), ["takeoff", "hold", "abort"], "interrupted; abort done: abort is done"),
        (("track", "ellipse"), ["track", "hold"], "interrupted; hold done: hold is done"),
        (("land",), ["land"], "interrupted: land was sent and continues; not waiting for its end"),
    ],
)
async def test_ctrl_c_makes_it_safe_and_says_how(
    there: BrokerProcess, words: tuple[str, ...], sent: list[str], says: str
) -> None:
    async with serving(there) as (service, flight, where):
        flight.grounded = words == ("takeoff",)
        running = await start(*words, *where)
        await running.until_line("begins")
        running.interrupt()
        ran = await running.ended()
    assert (ran.code, [one.verb for one in service.taken]) == (130, sent)
    assert ran.err.splitlines()[-1] == f"companion: {says}"


async def test_a_second_ctrl_c_leaves_without_waiting(there: BrokerProcess) -> None:
    async def never(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, f"{command.verb} begins"
        begun.set()

    begun = asyncio.Event()
    async with scripted(there.port, "twice", never) as service:
        running = await start("track", "figure8", "--broker", f"mqtt://127.0.0.1:{there.port}", "--vehicle", "twice")
        for verb in ("track", "hold"):
            await begun.wait()
            begun.clear()
            await running.until_line(f"{verb} begins")
            running.interrupt()
        ran = await running.ended()
    assert (ran.code, [one.verb for one in service.taken]) == (130, ["track", "hold"])
    assert ran.err.splitlines()[-1] == "companion: interrupted: hold was sent and continues; not waiting for its end"


async def test_a_client_that_is_killed_harms_nothing_and_the_next_one_goes_on(there: BrokerProcess) -> None:
    async with serving(there) as (service, flight, where):
        running = await start("takeoff", *where)
        await running.until_line("begins")
        running.send(signal.SIGKILL)
        assert (await running.ended()).code == -signal.SIGKILL
        assert not flight.over.is_set()
        assert (await run("hold", *where)).code == 0
    assert [one.verb for one in service.taken] == ["takeoff", "hold"]


async def test_json_is_one_object_a_line_and_nothing_else(there: BrokerProcess) -> None:
    async with serving(there) as (_, _, where):
        hold = await run("hold", "--json", *where)
        none = await run("hold", "--json", *where, "--vehicle", "nobody")
        state = await run("status", "--json", "--once", *where)
    assert [one.get("answer") or one["code"] for one in objects(hold)] == ["accepted", "done", 0]
    assert [(one["type"], one["code"]) for one in objects(none)] == [("end", 3)]
    assert (state.code, [one["phase"] for one in objects(state)]) == (0, ["standby"])
    assert hold.err + none.err + state.err == ""


async def test_the_list_of_checks_is_printed_and_its_code_is_1_when_one_fails(there: BrokerProcess) -> None:
    async def checks(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, "looking"
        yield Answer.FAILED, "1 of 2 checks fail: arming is refused"

    good = {"name": "body seen", "passed": True, "says": "in 100 %", "todo": "", "must": True}
    bad = {"name": "battery", "passed": False, "says": "11 %", "todo": "charge it", "must": True}
    async with scripted(there.port, "checked", checks) as service:
        service.data = {"checks": [good, bad]}
        ran = await run("preflight", "--broker", f"mqtt://127.0.0.1:{there.port}", "--vehicle", "checked")
    assert ran.code == 1
    assert [line.split()[0] for line in ran.out.splitlines()] == ["looking", "pass", "FAIL", "->"]
    assert "charge it" in ran.out
    assert ran.said.count("arming is refused") == 1, "one sum, not two"


async def test_as_many_waypoints_as_a_file_may_have_fit_into_one_command(there: BrokerProcess, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    rows = [f"{0.1 * n:.17g},{n / 700:.17g},-{n / 900:.17g},1.0123456789012345,-0.123456" for n in range(MAX_WAYPOINTS)]
    path.write_text("\n".join(["t_s,x_m,y_m,z_m,yaw_rad", *rows]))
    async with serving(there) as (service, _, where):
        ran = await run("track", path, "--arms", "swing", "--no-wait", *where)
    assert ran.code == 0, ran.said
    (taken,) = service.taken
    assert isinstance(taken, Track)
    assert taken.waypoints is not None
    assert len(taken.waypoints) == MAX_WAYPOINTS
    assert (taken.arms, taken.waypoints[7].x_m) == ("swing", 0.01)


async def test_the_arms_of_the_running_service(there: BrokerProcess) -> None:
    async with serving(there) as (service, _, where):
        ran = await run("arms", "live", "play", "swing", *where)
    assert ran.code == 0, ran.said
    assert [(one.do, one.motion) for one in service.taken if isinstance(one, Arms)] == [("play", "swing")]
