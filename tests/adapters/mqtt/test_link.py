"""Commands over a real broker, and what becomes of the link when the broker is not there, goes, hangs or comes back."""

import asyncio
import time
from collections.abc import Iterator

import aiomqtt
import pytest

from companion.config.companion_config import load_config
from companion.config.locations import default_config_path
from companion.core.interfaces import FlightError
from companion.protocol.about import About
from companion.protocol.telemetry import Answer, Happened, Kind, Reply
from companion.service.about import about_of
from companion.supervisor.safety_rules import SafetyRules
from tests.adapters.mqtt.rig import (
    SESSION,
    TOPICS,
    V5,
    V311,
    Vehicle,
    command,
    linked,
    open_files,
    operated,
    operating,
    state,
    ticking,
    until,
)
from tests.adapters.qualisys.qtm_scripts import Silent, listening
from tests.beside import Beside
from tests.broker import BrokerProcess, broker
from tests.mosquitto import mosquitto, needs_mosquitto

pytestmark = pytest.mark.realtime
beside = Beside(at_once=4)

BLOCKED_S = 0.5
"""Every time-out of the link is longer: a loop that waited one out would show."""

Served = tuple[int, aiomqtt.ProtocolVersion]
MINE = TOPICS.reply("me")


@pytest.fixture(scope="module", params=[pytest.param("mosquitto", marks=needs_mosquitto), "amqtt"])
def served(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Yield port and MQTT version of a mosquitto with MQTT 5 and of the embedded broker, which knows only 3.1.1."""
    if request.param == "amqtt":
        with broker() as process:
            yield process.port, V311
    else:
        with mosquitto(tmp_path_factory.mktemp("mosquitto"), "allow_anonymous true", "set_tcp_nodelay true") as port:
            yield port, V5


async def test_a_command_reaches_the_vehicle_and_its_answers_the_sender(served: Served) -> None:
    vehicle = Vehicle()
    async with operated(served[0], vehicle, served[1]) as (_, operator):
        for verb in ("hold", "land", "abort", "kill"):
            confirmed = {"confirm": "kill"} if verb == "kill" else {}
            name = await operator.order(verb, reply_to="me", **confirmed)
            for answer in ("accepted", "done"):
                await operator.hears(MINE, id=name, answer=answer)
            assert vehicle.told[-1] == (verb, name)


async def test_who_comes_later_hears_what_the_vehicle_is(served: Served) -> None:
    port, version = served
    about = about_of(load_config(default_config_path("demo.toml")), SESSION)
    async with linked(port, Vehicle(), about, embedded=version is V311) as link:
        await until(lambda: link.age_s() == 0.0)
        async with operating(port, version) as operator:
            said = await operator.hears(TOPICS.about)
    assert About.model_validate_json(said.payload) == about


async def test_who_names_nobody_is_answered_by_an_event(served: Served) -> None:
    async with operated(served[0], Vehicle(), served[1]) as (_, operator):
        name = await operator.order("hold")
        for answer in ("accepted", "done"):
            await operator.hears(TOPICS.event, kind="reply", name=answer, id=name)


async def test_a_response_topic_goes_before_reply_to_but_only_one_of_this_vehicle(served: Served) -> None:
    port, version = served
    if version is not V5:
        pytest.skip("MQTT 3.1.1 has no response topic")
    async with operated(port, Vehicle(), version) as (_, operator):
        laptop = TOPICS.reply("laptop")
        await operator.say(command("hold", "a", reply_to="me"), ResponseTopic=laptop, CorrelationData=b"\x00\xff7")
        for answer in ("accepted", "done"):
            said = await operator.hears(laptop, id="a", answer=answer)
            assert said.correlation == b"\x00\xff7"
        for number, other in enumerate(
            (TOPICS.command, TOPICS.status, "dauam/v1/other/reply/me", MINE + "/x", "$SYS/x")
        ):
            await operator.say(command("hold", f"b{number}", reply_to="me"), ResponseTopic=other, CorrelationData=b"8")
            assert (await operator.hears(MINE, id=f"b{number}", answer="done")).correlation == b"8"
            await operator.say(command("hold", f"c{number}"), ResponseTopic=other)
            await operator.hears(TOPICS.event, kind="reply", name="done", id=f"c{number}")


async def test_a_response_topic_among_more_properties_than_are_read_is_not_used(served: Served) -> None:
    port, version = served
    if version is not V5:
        pytest.skip("MQTT 3.1.1 has no properties")
    async with operated(port, Vehicle(), version) as (_, operator):
        await operator.say(command("hold", "a"), ResponseTopic=MINE, UserProperty=[("", "")] * 200)
        await operator.hears(TOPICS.event, kind="reply", name="done", id="a")


async def test_what_is_refused_changes_nothing_and_the_operator_is_told(served: Served) -> None:
    vehicle = Vehicle()
    async with operated(served[0], vehicle, served[1]) as (_, operator):
        await operator.say(b'{"verb": "kill", "id": "k", "reply_to": "me"}')
        said = await operator.hears(MINE, id="k", answer="refused")
        assert "is missing" in said.json["text"]
        await operator.order("land", id="late", sent_s=time.time() - 6.0)
        assert (await operator.refusal("late")).startswith("sent ")
        await operator.say(b"\x00" * 50_000)
        assert await operator.refusal() == "50000 bytes are no command: at most 48000"
        assert vehicle.commands == []
        await operator.order("hold", id="twice")
        await operator.order("hold", id="twice")
        assert await operator.refusal("twice") == "this id was taken already"
        assert vehicle.told == [("hold", "twice")]


async def test_what_the_flight_cannot_do_is_refused_and_a_defect_of_it_no_end(served: Served) -> None:
    vehicle = Vehicle()
    async with operated(served[0], vehicle, served[1]) as (link, operator):
        vehicle.error = FlightError("cannot resume in phase standby")
        name = await operator.order("resume")
        assert await operator.refusal(name) == "cannot resume in phase standby"
        vehicle.error = ZeroDivisionError()
        name = await operator.order("hold", reply_to="me")
        assert (await operator.hears(MINE, id=name)).json["answer"] == "failed"
        vehicle.error = None
        await operator.order("abort")
        await until(lambda: vehicle.commands[-1].verb == "abort")
        assert link.age_s() == 0.0


async def test_an_abort_comes_through_a_flood(served: Served) -> None:
    vehicle = Vehicle()
    async with operated(served[0], vehicle, served[1]) as (_, operator):
        async with ticking() as longest_s:
            for _ in range(300):
                await operator.say(b"\xff" * 100)
            await operator.order("abort")
            await until(lambda: vehicle.commands)
        assert longest_s[0] < BLOCKED_S


async def test_a_retained_command_is_refused_or_never_read(served: Served) -> None:
    """One that was published to stay would be heard anew after every break of the connection."""
    port, version = served
    vehicle = Vehicle()
    async with operating(port, version) as operator:
        await operator.say(command("abort", "kept"), retain=True)
    async with operated(port, vehicle, version) as (_, operator):
        if version is V5:
            await operator.say(command("abort", "now"), retain=True)
            assert "without retain" in await operator.refusal("now")
        name = await operator.order("hold")
        await until(lambda: vehicle.commands)
        assert vehicle.told == [("hold", name)]
        await operator.say(b"", retain=True)


async def test_everyone_sees_whether_the_vehicle_listens(served: Served) -> None:
    port, version = served
    async with linked(port, Vehicle()) as link:
        await until(lambda: link.age_s() == 0.0)
        async with operating(port, version) as late_comer:
            said = (await late_comer.hears(TOPICS.status, online=True)).json
            assert (said["session"], said["vehicle"]) == (SESSION, "vehicle")
            assert abs(said["since_s"] - time.time()) < 60.0
    async with operating(port, version) as afterwards:
        await afterwards.hears(TOPICS.status, online=False)


@beside
async def test_events_wait_for_a_broker_and_of_states_only_the_newest_does() -> None:
    process = BrokerProcess()
    try:
        async with linked(process.port, Vehicle()) as link:
            for number in range(300):
                link.tell(Happened(time_s=float(number), kind=Kind.LOG, text="flying"))
                link.show(state(number))
            await asyncio.to_thread(process.start)
            async with operating(process.port) as operator:
                await operator.hears(TOPICS.state, time_s=299.0)
                link.tell(Happened(time_s=1000.0, kind=Kind.LOG, text="last"))
                heard = []
                while (time_s := (await operator.hears(TOPICS.event)).json["time_s"]) < 1000.0:
                    heard.append(time_s)
                assert heard == sorted(heard)
    finally:
        process.stop()


async def test_every_event_comes_in_order_and_a_state_at_once(served: Served) -> None:
    async with operated(served[0], Vehicle(), served[1]) as (link, operator):
        for number in range(100):
            link.tell(Happened(time_s=float(number), kind=Kind.LOG, text=f"{number}"))
        for number in range(100):
            assert (await operator.hears(TOPICS.event)).json["text"] == str(number)
        link.show(state(7))
        assert (await operator.hears(TOPICS.state)).json["time_s"] == 7.0


async def test_the_last_words_are_heard(served: Served) -> None:
    port, version = served
    async with linked(port, Vehicle(), embedded=version is V311) as link:
        await until(lambda: link.age_s() == 0.0)
        async with operating(port, version) as operator:
            link.tell(Happened(time_s=1.0, kind=Kind.LOG, text="the first"))
            await operator.hears(TOPICS.event, text="the first")
            listening = asyncio.create_task(operator.hears(TOPICS.event, text="the last"))
            async with linked(port, Vehicle(), embedded=version is V311) as other:
                await until(lambda: other.age_s() == 0.0)
                for number in range(50):
                    other.tell(Happened(time_s=1.0, kind=Kind.LOG, text=str(number)))
                other.tell(Happened(time_s=1.0, kind=Kind.LOG, text="the last"))
            await listening


async def test_what_cannot_be_said_does_no_harm(served: Served) -> None:
    vehicle = Vehicle()
    async with operated(served[0], vehicle, served[1]) as (link, operator):
        link.tell(Happened.model_construct(time_s=0.0, kind=Kind.LOG, text="\ud800"))
        vehicle.on_command = lambda command, answer: answer(  # type: ignore[method-assign]
            Reply(id=command.id, answer=Answer.DONE, time_s=0.0, data={"nothing that JSON has": object()})
        )
        await operator.order("params", reply_to="me")
        link.tell(Happened(time_s=1.0, kind=Kind.LOG, text="good"))
        await operator.hears(TOPICS.event, text="good")
        assert link.age_s() == 0.0


@beside
async def test_a_broker_that_comes_late_goes_and_comes_back() -> None:
    vehicle, process = Vehicle(), BrokerProcess()
    try:
        async with ticking() as longest_s, linked(process.port, vehicle) as link:
            await until(lambda: link.age_s() > 0.5)
            for round_trip in range(1, 3):
                await asyncio.to_thread(process.start)
                await until(lambda: link.age_s() == 0.0)
                async with operating(process.port) as operator:
                    await operator.order("hold")
                    await until(lambda round_trip=round_trip: len(vehicle.commands) == round_trip)  # type: ignore[misc]
                await asyncio.to_thread(process.stop)
                await until(lambda: link.age_s() > 0.0)
            assert longest_s[0] < BLOCKED_S
    finally:
        process.stop()


@beside
async def test_a_broker_that_hangs_is_as_good_as_gone() -> None:
    vehicle = Vehicle()
    with broker() as process:
        async with ticking() as longest_s, linked(process.port, vehicle) as link:
            await until(lambda: link.age_s() == 0.0)
            process.hang()
            await until(lambda: link.age_s() > SafetyRules().operator_gone_s)
            process.go_on()
            await until(lambda: link.age_s() == 0.0)
            async with operating(process.port) as operator:
                await operator.order("land")
                await until(lambda: vehicle.commands)
            assert longest_s[0] < BLOCKED_S


@beside
async def test_a_server_that_says_nothing_costs_nothing_and_leaves_nothing() -> None:
    open_before = open_files()
    async with listening(Silent) as port:
        async with ticking() as longest_s, linked(port, Vehicle()) as link:
            await until(lambda: link.age_s() > SafetyRules().operator_gone_s)
        for _ in range(5):
            async with linked(port, Vehicle()):
                await asyncio.sleep(0.0)
        assert longest_s[0] < BLOCKED_S
    await until(lambda: open_files() <= open_before)
