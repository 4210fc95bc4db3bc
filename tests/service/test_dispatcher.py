"""Commands carried out on a whole vehicle in simulated time: what is accepted, what ends how, what excludes what."""

import asyncio
import itertools
import json
import re
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import FlightConfig
from companion.core.interfaces import FlightError
from companion.preflight.checks.check import Check
from companion.protocol.check import Tell
from companion.protocol.commands import COMMAND
from companion.protocol.telemetry import ENDS, Answer, Reply
from companion.service.dispatcher import CommandDispatcher
from companion.service.flight_actions import DeviceReports
from companion.service.local_operator import LocalOperator
from companion.supervisor.flight_state import Phase
from tests.flights.simulated import Room
from tests.flights.test_simulated_arms import ARMS, mock_arms, no_params
from tests.service.test_flight_actions import BOOTED_S, Served, served

pytestmark = pytest.mark.slow

SESSION = "0123456789abcdef"
BRISK = FlightConfig(climb_speed_mps=1.0, descent_speed_mps=0.6, spool_up_s=0.5, settle_s=0.2)
ARMED = "the vehicle is armed already: run `companion takeoff`, or `companion disarm` to stop the motors"
IN_AIR = "the vehicle is in the air, and this is for the ground: run `companion land` first"
_IDS = itertools.count()


@dataclass
class SentCommand:
    """One command and all that was answered to it."""

    replies: list[Reply] = field(default_factory=list)
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    def hear(self, reply: Reply) -> None:
        assert not self.ended.is_set(), "nothing follows an end"
        self.replies.append(reply)
        if reply.answer in ENDS:
            self.ended.set()

    @property
    def answers(self) -> list[Answer]:
        return [reply.answer for reply in self.replies if reply.answer is not Answer.PROGRESS]

    async def end(self) -> Reply:
        async with asyncio.timeout(120.0):
            await self.ended.wait()
        return self.replies[-1]


@dataclass
class Operated:
    """A vehicle and its dispatcher, which serves it until `serving` is closed."""

    one: Served
    dispatcher: CommandDispatcher
    serving: AsyncExitStack

    def say(self, verb: str, **arguments: Any) -> SentCommand:
        data = {"verb": verb, "id": f"t-{next(_IDS)}", "session": SESSION, "sent_s": 1.0, **arguments}
        sent = SentCommand()
        self.dispatcher.take(COMMAND.validate_json(json.dumps(data)), sent.hear)
        return sent

    async def do(self, verb: str, **arguments: Any) -> Reply:
        return await self.say(verb, **arguments).end()


@asynccontextmanager
async def operated(arms: bool = False, rival: str = "") -> AsyncIterator[Operated]:
    config = CompanionConfig(arms=ARMS if arms else None, flight=BRISK)
    room = Room(1, arms=mock_arms() if arms else None)
    async with served(room, config) as one, AsyncExitStack() as serving:
        await one.until(BOOTED_S)
        dispatcher = CommandDispatcher(config, lambda _: None, lambda: rival)
        await serving.enter_async_context(dispatcher.serving(one.service))
        yield Operated(one, dispatcher, serving)


async def arming_that_checks(op: Operated) -> SentCommand:
    """An arming whose checks have begun and take a while."""
    checking = asyncio.Event()

    async def check(_: Tell) -> Sequence[Check]:
        checking.set()
        await asyncio.sleep(0.1)
        return ()

    op.one.service.reports = DeviceReports(check, no_params)
    arming = op.say("arm")
    await checking.wait()
    return arming


async def flying(op: Operated) -> None:
    assert (await op.do("arm")).answer is Answer.DONE
    assert (await op.do("takeoff", height_m=0.8)).answer is Answer.DONE


async def test_a_whole_flight_by_commands() -> None:
    async with operated() as op:
        steps: list[str] = []
        operator = LocalOperator(op.dispatcher.take, steps.append)
        with pytest.raises(FlightError, match=r"^takeoff rejected: the vehicle is disarmed; run `companion arm` first"):
            await operator.do("takeoff")
        await operator.do("arm")
        assert steps == ["preflight checks, offboard mode, then arming"]
        takeoff = await op.do("takeoff", height_m=0.8)
        assert takeoff.answer is Answer.DONE
        assert "0.8 m" in takeoff.text
        assert (await op.do("goto", x_m=0.5, y_m=-0.3, z_m=1.0)).answer is Answer.DONE
        np.testing.assert_allclose(op.one.room.truth_w_m, [0.5, -0.3, 1.0], atol=0.1)
        assert (await op.do("track", curve="ellipse", laps=1, period_s=5.0, size=0.5)).answer is Answer.DONE
        assert (await op.do("land")).answer is Answer.DONE
        assert op.one.phase() is Phase.DISARMED
        assert (await op.do("arm")).answer is Answer.DONE, "and again"


async def test_acceptance_and_completion_are_told_apart() -> None:
    async with operated() as op:
        await flying(op)
        going = op.say("goto", x_m=0.4, y_m=0.0, z_m=0.8)
        while not going.replies:  # noqa: ASYNC110
            await asyncio.sleep(0)
        assert going.answers == [Answer.ACCEPTED]
        assert op.dispatcher.doing is not None
        assert op.dispatcher.doing.verb == "goto"
        await going.end()
        assert going.answers == [Answer.ACCEPTED, Answer.DONE]
        assert op.dispatcher.doing is None


@pytest.mark.parametrize(
    ("verb", "arguments", "why"),
    [
        ("takeoff", {}, "^the vehicle is disarmed; run `companion arm` first$"),
        (
            "goto",
            {"x_m": 0.0, "y_m": 0.0, "z_m": 1.0},
            "^the vehicle is disarmed; run `companion arm`, then `companion takeoff` first$",
        ),
        ("track", {"curve": "ellipse"}, "^the vehicle is disarmed; run"),
        ("hold", {}, "^the vehicle is on the ground$"),
        ("resume", {}, "says that the vehicle is on the ground$"),
        ("controller", {"name": "nobody"}, "unknown controller 'nobody'"),
        ("arms", {"do": "stow"}, "no arms"),
    ],
)
async def test_what_does_not_fit_is_refused_and_changes_nothing(verb: str, arguments: dict[str, Any], why: str) -> None:
    async with operated() as op:
        before = op.one.service.loop.flight
        sent = op.say(verb, **arguments)
        reply = await sent.end()
        assert sent.answers == [Answer.REFUSED]
        assert re.search(why, reply.text), reply.text
        assert op.one.service.loop.flight is before


async def test_what_leads_out_of_the_room_is_refused_in_flight() -> None:
    async with operated() as op:
        await flying(op)
        for verb, arguments in (
            ("goto", {"x_m": 4.4, "y_m": 0.0, "z_m": 1.0}),
            ("track", {"curve": "ellipse", "size": 3.0, "period_s": 5.0}),
            ("track", {"waypoints": [{"t_s": t, "x_m": t, "y_m": 0.0, "z_m": 1.0} for t in (0.0, 9.0)]}),
        ):
            sent = op.say(verb, **arguments)
            await sent.end()
            assert sent.answers == [Answer.REFUSED], verb
        assert op.one.phase() is Phase.HOLD


async def test_a_second_flight_command_waits_for_nobody_and_is_refused() -> None:
    async with operated() as op:
        assert (await op.do("arm")).answer is Answer.DONE
        said = await op.do("arm")
        assert (said.answer, said.text) == (Answer.REFUSED, ARMED)
        assert (await op.do("takeoff", height_m=0.8)).answer is Answer.DONE
        for arguments in ({"verb": "arm"}, {"verb": "arms", "do": "limp"}):
            assert (await op.do(**arguments)).text == IN_AIR, "it is its own flight"
        first = op.say("goto", x_m=0.4, y_m=0.0, z_m=0.8)
        second = op.say("goto", x_m=0.0, y_m=0.0, z_m=0.8)
        assert second.answers == [Answer.REFUSED]
        assert "goto" in second.replies[0].text
        assert (await first.end()).answer is Answer.DONE


@pytest.mark.parametrize(
    ("verb", "phase", "why"),
    [
        ("hold", Phase.HOLD, "ended by another command: a hold was ordered, the vehicle hovers"),
        ("land", Phase.DISARMED, "the flight was ended: a landing was ordered"),
        ("abort", Phase.DISARMED, "the flight was ended: the operator aborted"),
    ],
)
async def test_what_must_not_wait_ends_what_is_under_way_and_is_named(verb: str, phase: Phase, why: str) -> None:
    async with operated() as op:
        await flying(op)
        tracking = op.say("track", curve="figure8")
        while op.one.phase() is not Phase.TRACK:  # noqa: ASYNC110
            await asyncio.sleep(0)
        reply = await op.do(verb)
        assert reply.answer is Answer.DONE
        ended = await tracking.end()
        assert (ended.answer, ended.text) == (Answer.FAILED, why)
        assert op.one.phase() is phase
    if verb == "abort":
        assert "aborted" in reply.text


async def test_beside_another_service_of_its_name_nothing_is_armed() -> None:
    rival = "another service has this vehicle's name"
    async with operated(rival=rival) as op:
        said = await op.do("arm")
        assert (said.answer, said.text) == (Answer.REFUSED, rival)


async def test_kill_stops_the_motors_in_the_air() -> None:
    async with operated() as op:
        await flying(op)
        assert (await op.do("kill", confirm="kill")).answer is Answer.DONE
        assert op.one.phase() is Phase.TERMINATED
        assert not op.one.service.status.armed


async def test_disarm_is_for_the_ground() -> None:
    async with operated() as op:
        assert (await op.do("arm")).answer is Answer.DONE
        assert (await op.do("disarm")).answer is Answer.DONE
        assert not op.one.service.status.armed
        await flying(op)
        reply = await op.do("disarm")
        assert reply.answer is Answer.REFUSED
        assert "in the air" in reply.text


@pytest.mark.parametrize("verb", ["disarm", "abort", "land"])
async def test_what_ends_an_arming_ends_the_checks_before_it(verb: str) -> None:
    async with operated() as op:
        arming = await arming_that_checks(op)
        assert (await op.do(verb)).answer is Answer.DONE
        assert (await arming.end()).answer is Answer.FAILED
        assert op.one.phase() is Phase.STANDBY


async def test_who_ends_the_next_arming_is_not_told_of_the_last_flight() -> None:
    async with operated() as op:
        await flying(op)
        assert "aborted" in (await op.do("abort")).text
        arming = await arming_that_checks(op)
        reply = await op.do("land")
        assert reply.answer is Answer.DONE
        assert "aborted" not in reply.text
        assert (await arming.end()).answer is Answer.FAILED


async def test_another_law_takes_over_in_the_air_and_is_named() -> None:
    async with operated() as op:
        await flying(op)
        reply = await op.do("controller", name="pid")
        assert reply.answer is Answer.DONE, reply
        assert op.one.service.loop.law_name == "pid"
        await asyncio.sleep(0)
        assert op.one.phase() is Phase.HOLD
        away_m = np.linalg.norm(op.one.room.truth_w_m[:2])
        assert away_m < 0.4


async def test_a_trajectory_with_the_arms_swinging_ends_with_the_arms_at_rest() -> None:
    async with operated(arms=True) as op:
        await flying(op)
        reply = await op.do("track", curve="ellipse", laps=1, period_s=5.0, size=0.5, arms="swing")
        assert reply.answer is Answer.DONE, reply
        assert op.one.service.loop.arms is not None
        assert (await op.do("arms", do="stow")).answer in {Answer.DONE, Answer.REFUSED}
        assert (await op.do("land")).answer is Answer.DONE


async def test_parameters_are_told() -> None:
    async with operated() as op:
        reply = await op.do("params")
        assert reply.answer is Answer.DONE
        assert reply.data["config"]["vehicle"]["mass_kg"] == 4.85
        assert reply.data["controller"]["law"] == "etnn"


async def test_a_dispatcher_that_closes_answers_what_is_under_way() -> None:
    async with operated() as op:
        await flying(op)
        going = op.say("goto", x_m=0.4, y_m=0.0, z_m=0.8)
        while not going.replies:  # noqa: ASYNC110
            await asyncio.sleep(0)
        await op.serving.aclose()
        assert (await going.end()).answer is Answer.FAILED
        late = op.say("takeoff")
        assert late.answers == [Answer.REFUSED]
