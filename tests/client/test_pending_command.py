"""The operator's client against a service that speaks the bus, over a real broker."""

import asyncio
import itertools
from collections.abc import Sequence
from typing import Any

import pytest

from companion.adapters.mqtt import connection
from companion.client import first_connection, pending_command
from companion.client.client import Console, open_console
from companion.client.command_draft import CommandDraft
from companion.client.errors import NoServiceError, UnknownOutcomeError
from companion.client.messages import Link
from companion.client.pending_command import PendingCommand
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import ConfigError
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Doing, Presence, Reply, State
from tests.broker import BrokerProcess, broker
from tests.client.scripted import Answers, ScriptedService, scripted

pytestmark = pytest.mark.slow

_NUMBER = itertools.count()


def vehicle() -> str:
    return f"v{next(_NUMBER)}"


async def run(place: OperatorConfig, draft: CommandDraft) -> list[object]:
    async with open_console(place) as console:
        return [said async for said in PendingCommand(console, draft).messages()]


def answers(said: Sequence[object]) -> list[Answer]:
    return [one.answer for one in said if isinstance(one, Reply)]


async def test_a_command_reaches_a_service_whose_clock_is_an_hour_ahead(shared_broker: BrokerProcess) -> None:
    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle) as service:
        said = await run(place, CommandDraft("takeoff", height_m=1.5))
    assert answers(said) == [Answer.ACCEPTED, Answer.DONE]
    assert [(one.verb, getattr(one, "height_m", None)) for one in service.taken] == [("takeoff", 1.5)]
    assert service.refusals == []


async def test_nobody_there_is_one_sentence_whether_absent_gone_or_silent(shared_broker: BrokerProcess) -> None:
    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    with pytest.raises(NoServiceError, match=r"no service of 'v\d+' at mqtt://127.0.0.1:\d+ is running"):
        await run(place, CommandDraft("arm"))
    async with scripted(place.port, place.vehicle) as service:
        await run(place, CommandDraft("hold"))
        service.silent = True
        with pytest.raises(NoServiceError, match="has sent nothing for 2 s"):
            await run(place, CommandDraft("arm"))
        await service.present(online=False)
        with pytest.raises(NoServiceError, match="is running"):
            await run(place, CommandDraft("arm"))
    assert [one.verb for one in service.taken] == ["hold"]
    with pytest.raises(NoServiceError, match=r"no broker at mqtt://127\.0\.0\.1:9 .Connection refused.: start"):
        await run(OperatorConfig(port=9), CommandDraft("arm"))


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
            async for one in PendingCommand(console, CommandDraft("takeoff")).messages():
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
                async for one in PendingCommand(console, CommandDraft("takeoff")).messages():
                    said.append(one)
                    if answers(said) == [Answer.ACCEPTED] and service.doing is not None:
                        await asyncio.to_thread(own.stop)
                        service.doing, service.phase, service.height_m = None, "hold", 1.2
                        await asyncio.to_thread(own.start)

            with pytest.raises(
                UnknownOutcomeError, match=r"ended while the connection was broken.* hold, disarmed, 1\.20 m"
            ):
                await follow()


async def test_an_answer_that_was_lost_is_not_waited_for_for_ever(shared_broker: BrokerProcess) -> None:
    async def forgets(service: ScriptedService, command: Command) -> Answers:
        service.doing = Doing(id=command.id, verb=command.verb)
        yield Answer.ACCEPTED, ""
        await asyncio.sleep(0.5)
        service.doing = None

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, forgets):
        with pytest.raises(
            UnknownOutcomeError, match=r"goto: it is not carried out any more, and how it ended was not heard; now"
        ):
            await run(place, CommandDraft("goto", x_m=0.0, y_m=0.0, z_m=1.0))


async def test_arms_that_move_beside_the_flights_command_are_waited_for(
    shared_broker: BrokerProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pending_command, "_AT_ONCE_S", 0.2)
    monkeypatch.setattr(pending_command, "_UNSEEN_S", 0.2)

    async def plays(service: ScriptedService, command: Command) -> Answers:
        service.doing = Doing(id=command.id, verb=command.verb)
        yield Answer.ACCEPTED, ""
        await asyncio.sleep(0.2)
        service.doing = Doing(id="another", verb="goto")
        await asyncio.sleep(1.0)
        yield Answer.DONE, "played"

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, plays):
        assert answers(await run(place, CommandDraft("arms", do="stow"))) == [Answer.ACCEPTED, Answer.DONE]


async def test_a_service_that_was_restarted_knows_nothing_of_the_command(shared_broker: BrokerProcess) -> None:
    async def dies(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""
        service.session = "f" * 16
        await service.present(online=True)

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, dies):
        with pytest.raises(UnknownOutcomeError, match="arm: the service was restarted meanwhile"):
            await run(place, CommandDraft("arm"))


@pytest.mark.parametrize("online", [True, False])
async def test_a_status_that_anybody_left_at_the_broker_ends_no_command(
    shared_broker: BrokerProcess, online: bool
) -> None:
    """Retained, of a run that says nothing else: before the command, and while it is carried out."""

    async def disturbed(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""
        await leave(service)
        await asyncio.sleep(1.5)
        yield Answer.DONE, "it hovers"

    async def leave(service: ScriptedService) -> None:
        said = Presence(online=online, session="e" * 16, vehicle="vehicle")
        await service.publish(service.topics.status, said.model_dump_json(), retain=True)

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, disturbed) as service:
        await leave(service)
        assert answers(await run(place, CommandDraft("hold"))) == [Answer.ACCEPTED, Answer.DONE]


async def test_of_two_services_of_one_name_the_answer_of_the_one_that_was_meant_counts(
    shared_broker: BrokerProcess,
) -> None:
    """Both hear every command; the second refuses what names the session of the first."""

    async def obeys(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""
        await asyncio.sleep(0.5)
        yield Answer.DONE, "it hovers"

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, obeys) as first, open_console(place) as console:
        assert (await console.find()).session == first.session
        async with scripted(place.port, place.vehicle, session="d" * 16) as second:
            said = [one async for one in PendingCommand(console, CommandDraft("hold")).messages()]
            assert second.taken == []
    assert answers(said) == [Answer.ACCEPTED, Answer.DONE]
    assert {one.session for one in said if isinstance(one, State | Reply)} == {first.session}


@pytest.mark.parametrize("behaviour", ["silent", "closes", "accepts and closes"])
async def test_a_broker_that_hangs_or_breaks_off_ends_every_wait_with_a_sentence(behaviour: str) -> None:
    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if behaviour == "silent":
            await reader.read()
        elif behaviour == "accepts and closes":
            await reader.read(100)
            writer.write(b"\x20\x02\x00\x00")
        writer.close()

    async with await asyncio.start_server(converse, "127.0.0.1", 0) as server:
        place = OperatorConfig(port=server.sockets[0].getsockname()[1])
        with pytest.raises(NoServiceError, match=r"does not answer .*, so it is not known whether the service runs"):
            await run(place, CommandDraft("arm"))


async def test_a_broker_whose_computer_lost_its_power_is_noticed_by_its_silence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The connection stays open, as far as TCP tells; a keep-alive passes twice, and the client connects again."""
    monkeypatch.setattr(connection, "KEEPALIVE_S", 1)
    with broker() as own:
        place = OperatorConfig(port=own.port, vehicle=vehicle())
        async with scripted(own.port, place.vehicle), open_console(place) as console:
            await console.find()
            own.hang()
            try:
                async with asyncio.timeout(15.0):
                    with console.inbox() as inbox:
                        while not isinstance(said := await inbox.next(None), Link):
                            pass
            finally:
                own.go_on()
            assert not said.there


async def test_a_connection_that_is_never_made_or_that_fails_oddly_is_no_wait_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A name service that does not answer, and a defect in a library."""

    async def odd(_: Console) -> None:
        raise KeyError("odd")

    monkeypatch.setattr(first_connection, "_TIMEOUT_S", 0.1)
    for keep, expected in ((lambda _: asyncio.sleep(60.0), NoServiceError), (odd, KeyError)):
        monkeypatch.setattr(Console, "keep", keep)
        with pytest.raises(expected):
            await run(OperatorConfig(port=9), CommandDraft("arm"))


async def test_giving_up_after_the_timeout_says_that_it_goes_on(shared_broker: BrokerProcess) -> None:
    async def never(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""

    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle, never), open_console(place) as console:
        with pytest.raises(UnknownOutcomeError, match=r"land: not over after 0.3 s; it goes on; now: phase standby"):
            _ = [said async for said in PendingCommand(console, CommandDraft("land"), timeout_s=0.3).messages()]


async def test_messages_that_are_no_words_of_the_service_are_passed_over(shared_broker: BrokerProcess) -> None:
    place = OperatorConfig(port=shared_broker.port, vehicle=vehicle())
    async with scripted(place.port, place.vehicle) as service, open_console(place) as console:
        await console.find()
        for topic in (service.topics.state, service.topics.status, service.topics.event):
            await service.publish(topic, '{"time_s": NaN, "online": "yes"}')
        said = [one async for one in PendingCommand(console, CommandDraft("hold")).messages()]
    assert answers(said) == [Answer.ACCEPTED, Answer.DONE]


def test_what_the_service_would_not_read_is_said_before_anything_is_sent() -> None:
    fields: dict[str, Any]
    for fields, sentence in (
        ({"verb": "takeoff", "height_m": -1.0}, "takeoff: height_m = -1.0: must be above 0"),
        ({"verb": "goto", "x_m": float("nan"), "y_m": 0.0, "z_m": 1.0}, "goto: x_m = nan: must be a finite"),
        ({"verb": "track"}, "track: give either curve or waypoints"),
        ({"verb": "controller", "name": "PID!"}, "controller: name = 'PID!': must be 1 to 64 characters of a-z0-9_-"),
    ):
        with pytest.raises(ConfigError) as error:
            CommandDraft(**fields)
        assert str(error.value).startswith(sentence)


async def test_after_a_broken_connection_a_landing_is_sent_late_and_a_takeoff_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pending_command, "_LATE_S", 0.05)
    with broker() as own:
        place = OperatorConfig(port=own.port, vehicle=vehicle())
        async with scripted(own.port, place.vehicle) as service, open_console(place) as console:
            await console.find()
            await asyncio.to_thread(own.stop)
            with console.inbox() as inbox:
                while console.linked:
                    await inbox.next(1.0)
            given = [PendingCommand(console, CommandDraft(verb)) for verb in ("takeoff", "land")]
            ends = asyncio.gather(*(ended(one) for one in given), return_exceptions=True)
            await asyncio.sleep(0.1)
            await asyncio.to_thread(own.start)
            takeoff, land = await ends
    assert isinstance(takeoff, NoServiceError)
    assert "takeoff: nothing was sent" in str(takeoff)
    assert land == [Answer.ACCEPTED, Answer.DONE]
    assert [one.verb for one in service.taken] == ["land"]


async def ended(command: PendingCommand) -> list[Answer]:
    return answers([said async for said in command.messages()])
