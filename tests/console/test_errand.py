"""The operator's client against a service that speaks the bus, over a real broker."""

import asyncio
import itertools
from collections.abc import Sequence
from typing import Any

import pytest

from companion.bus.commands import Command
from companion.bus.telemetry import Answer, Doing, Reply, State
from companion.config_operator import OperatorConfig
from companion.console.client import Link, open_console
from companion.console.draft import Draft
from companion.console.errand import Errand
from companion.console.trouble import LostError, NobodyThereError
from companion.ports import ConfigError
from tests.broker import BrokerProcess, broker
from tests.console.scripted import Answers, ScriptedService, scripted

_NUMBER = itertools.count()


def vehicle() -> str:
    return f"v{next(_NUMBER)}"


async def run(place: OperatorConfig, draft: Draft) -> list[object]:
    async with open_console(place) as console:
        return [said async for said in Errand(console, draft).said()]


def answers(said: Sequence[object]) -> list[Answer]:
    return [one.answer for one in said if isinstance(one, Reply)]


async def test_a_command_reaches_a_service_whose_clock_is_an_hour_ahead(shared_broker: BrokerProcess) -> None:
    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle) as service:
        said = await run(place, Draft("takeoff", height_m=1.5))
    assert answers(said) == [Answer.ACCEPTED, Answer.DONE]
    assert [(one.verb, getattr(one, "height_m", None)) for one in service.taken] == [("takeoff", 1.5)]
    assert service.refusals == []


async def test_nobody_there_is_one_sentence_whether_absent_gone_or_silent(shared_broker: BrokerProcess) -> None:
    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    with pytest.raises(NobodyThereError, match=r"nobody there: the service of 'v\d+' at mqtt://127.0.0.1:\d+ does not"):
        await run(place, Draft("arm"))
    async with scripted(place.port, place.vehicle) as service:
        await run(place, Draft("hold"))
        service.silent = True
        with pytest.raises(NobodyThereError, match="has said nothing for 2 s"):
            await run(place, Draft("arm"))
        await service.present(online=False)
        with pytest.raises(NobodyThereError, match="does not run"):
            await run(place, Draft("arm"))
    assert [one.verb for one in service.taken] == ["hold"]
    with pytest.raises(NobodyThereError, match=r"no broker at mqtt://127\.0\.0\.1:9 .Connection refused"):
        await run(OperatorConfig(port=9), Draft("arm"))


async def test_a_restarted_broker_ends_no_wait_and_sends_nothing_twice() -> None:
    go_on = asyncio.Event()

    async def slowly(service: ScriptedService, command: Command) -> Answers:
        service.doing = Doing(id=command.id, verb=command.verb)
        yield Answer.ACCEPTED, ""
        await go_on.wait()
        service.doing = None
        yield Answer.DONE, "it hovers"

    with broker() as own:
        place = OperatorConfig(port=own.port, vehicle=vehicle())
        async with scripted(own.port, place.vehicle, slowly) as service, open_console(place) as console:
            said: list[object] = []
            async for one in Errand(console, Draft("takeoff")).said():
                said.append(one)
                if answers(said) == [Answer.ACCEPTED] and not any(isinstance(one, Link) for one in said):
                    await asyncio.to_thread(own.stop)
                    await asyncio.to_thread(own.start)
                if isinstance(said[-1], State) and Link(True) in said:
                    go_on.set()
    assert answers(said) == [Answer.ACCEPTED, Answer.DONE]
    assert len(service.taken) == 1


async def test_an_end_that_was_said_while_the_connection_was_broken_is_not_waited_for() -> None:
    async def begins(service: ScriptedService, command: Command) -> Answers:
        service.doing, service.phase = Doing(id=command.id, verb=command.verb), "takeoff"
        yield Answer.ACCEPTED, ""

    with broker() as own:
        place = OperatorConfig(port=own.port, vehicle=vehicle())
        async with scripted(own.port, place.vehicle, begins) as service, open_console(place) as console:
            said: list[object] = []

            async def follow() -> None:
                async for one in Errand(console, Draft("takeoff")).said():
                    said.append(one)
                    if answers(said) == [Answer.ACCEPTED] and service.doing is not None:
                        await asyncio.to_thread(own.stop)
                        service.doing, service.phase, service.height_m = None, "hold", 1.2
                        await asyncio.to_thread(own.start)

            with pytest.raises(LostError, match=r"ended while the connection was broken.* hold, disarmed, 1\.20 m"):
                await follow()


async def test_a_service_that_was_started_anew_knows_nothing_of_the_command(shared_broker: BrokerProcess) -> None:
    async def dies(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""
        service.session = "f" * 16
        await service.present(online=True)

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, dies):
        with pytest.raises(LostError, match="arm: the service was started anew meanwhile"):
            await run(place, Draft("arm"))


async def test_giving_up_after_the_timeout_says_that_it_goes_on(shared_broker: BrokerProcess) -> None:
    async def never(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, never), open_console(place) as console:
        with pytest.raises(LostError, match=r"land: not over after 0.3 s .--timeout.; it goes on; now: phase standby"):
            _ = [said async for said in Errand(console, Draft("land"), timeout_s=0.3).said()]


async def test_messages_that_are_no_words_of_the_service_are_passed_over(shared_broker: BrokerProcess) -> None:
    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle) as service, open_console(place) as console:
        await console.find()
        for topic in (service.topics.state, service.topics.status, service.topics.event):
            await service.publish(topic, '{"time_s": NaN, "online": "yes"}')
        said = [one async for one in Errand(console, Draft("hold")).said()]
    assert answers(said) == [Answer.ACCEPTED, Answer.DONE]


def test_what_the_service_would_not_read_is_said_before_anything_is_sent() -> None:
    fields: dict[str, Any]
    for fields, sentence in (
        ({"verb": "takeoff", "height_m": -1.0}, "takeoff: height_m = -1.0: input should be greater than 0"),
        ({"verb": "goto", "x_m": float("nan"), "y_m": 0.0, "z_m": 1.0}, "goto: x_m = nan: input should be a finite"),
        ({"verb": "track"}, "track: give either curve or waypoints"),
        ({"verb": "controller", "name": "PID!"}, "controller: name = 'PID!': string should match pattern"),
    ):
        with pytest.raises(ConfigError) as error:
            Draft(**fields)
        assert str(error.value).startswith(sentence)
