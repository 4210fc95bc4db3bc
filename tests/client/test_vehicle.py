"""A script's vehicle against a service that speaks the bus, over a real broker."""

import asyncio

import numpy as np
import pytest

from companion.client import (
    Check,
    ConfigError,
    FailedError,
    NoServiceError,
    Progress,
    RejectedError,
    State,
    TimedOutError,
    Vehicle,
    connect,
    connect_all,
    together,
)
from companion.protocol.commands import Arms, Command, GoTo, Kill
from companion.protocol.telemetry import Answer, Kind, Reply
from tests.broker import BrokerProcess
from tests.client.flight import Flight, flying, moves
from tests.client.scripted import Answers, ScriptedService, done

pytestmark = pytest.mark.slow


async def test_every_command_is_sent_with_its_fields_and_returns_the_services_sentence(
    shared_broker: BrokerProcess,
) -> None:
    async with flying(shared_broker, done) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        assert await vehicle.takeoff(1.5) == "takeoff is done"
        await vehicle.goto(np.array([0.5, -0.5, 1.0]), yaw_rad=0.1)
        await vehicle.track("ellipse", arms="swing")
        await vehicle.arms.play("swing")
        await vehicle.kill("kill")
        for order in (
            vehicle.arm, vehicle.hold, vehicle.land, vehicle.abort, vehicle.resume, vehicle.disarm, vehicle.arms.ready,
            vehicle.arms.stow, vehicle.arms.hold, vehicle.arms.limp, vehicle.arms.clear,
        ):  # fmt: skip
            await order()
        await vehicle.controller("pid")
    takeoff, goto, track, play, kill, *others = flown.service.taken
    assert getattr(takeoff, "height_m", None) == 1.5
    assert isinstance(goto, GoTo)
    assert (goto.x_m, goto.y_m, goto.z_m, goto.yaw_rad) == (0.5, -0.5, 1.0, 0.1)
    assert (getattr(track, "curve", None), getattr(track, "arms", None)) == ("ellipse", "swing")
    assert isinstance(play, Arms)
    assert isinstance(kill, Kill)
    assert [f"{one.verb} {one.do}" if isinstance(one, Arms) else one.verb for one in others] == [
        "arm", "hold", "land", "abort", "resume", "disarm", "arms ready", "arms stow", "arms hold", "arms limp",
        "arms clear", "controller",
    ]  # fmt: skip


async def test_what_a_vehicle_says_is_typed_and_its_vectors_are_arrays(shared_broker: BrokerProcess) -> None:
    async with flying(shared_broker, Flight()) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        flown.service.height_m = 1.25
        state = await vehicle.wait_until(lambda state: bool(state.in_air), timeout_s=10.0)
        assert isinstance(state, State)
        assert vehicle.name == flown.name
        assert vehicle.state_age_s < 5.0
        assert np.array_equal(vehicle.position_w_m, [0.0, 0.0, 1.25])
        assert np.array_equal(vehicle.velocity_w_mps, np.zeros(3))
        assert np.array_equal(vehicle.reference_w_m, [0.0, 0.0, 1.0])


async def test_states_and_events_are_streams_beside_a_command(shared_broker: BrokerProcess) -> None:
    async with flying(shared_broker, Flight()) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        events, states = vehicle.events(), vehicle.states()
        first = asyncio.ensure_future(anext(events))
        flying_to = asyncio.ensure_future(vehicle.goto((0.0, 0.0, 1.0)))
        async for state in states:
            if state.doing is not None:
                break
        await flown.service.tell(Kind.FAULT, "the pose is old", "mocap late")
        event = await first
        assert (event.kind, event.name) == (Kind.FAULT, "mocap late")
        await vehicle.hold()
        with pytest.raises(FailedError, match="goto failed: ended by another command"):
            await flying_to
        await states.aclose()
        await events.aclose()


async def test_each_reply_that_is_no_success_is_an_error_of_its_own_with_the_services_sentence(
    shared_broker: BrokerProcess,
) -> None:
    async def refuses(service: ScriptedService, command: Command) -> Answers:
        if command.verb == "takeoff":
            yield Answer.REFUSED, "the vehicle is disarmed; run `companion arm` first"
        else:
            yield Answer.ACCEPTED, ""
            yield Answer.FAILED, "1 of 1 checks fail: arming is refused"

    async with flying(shared_broker, refuses) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        flown.service.data = {
            "checks": [{"name": "battery", "passed": False, "says": "11 %", "todo": "charge it", "new": 1}]
        }
        with pytest.raises(RejectedError) as rejected:
            await vehicle.takeoff()
        with pytest.raises(FailedError) as failed:
            await vehicle.preflight()
        with pytest.raises(ConfigError, match=r"goto: z_m = -1\.0: must be above 0"):
            await vehicle.goto((0.0, 0.0, -1.0))
        with pytest.raises(ConfigError, match=r"arms: motion = .No motion.: must be"):
            await vehicle.arms.play("No motion")
    assert str(rejected.value) == "takeoff rejected: the vehicle is disarmed; run `companion arm` first"
    assert (rejected.value.verb, rejected.value.reason) == (
        "takeoff",
        "the vehicle is disarmed; run `companion arm` first",
    )
    assert failed.value.checks == (Check("battery", passed=False, says="11 %", todo="charge it"),)
    assert flown.verbs == ["takeoff", "preflight"], "what cannot be is not sent"


async def test_the_checks_of_a_preflight_and_the_parameters_are_returned(shared_broker: BrokerProcess) -> None:
    async with flying(shared_broker, done) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        flown.service.data = {"checks": [{"name": "battery", "passed": True, "says": "80 %"}]}
        assert await vehicle.preflight() == (Check("battery", passed=True, says="80 %"),)
        flown.service.data = {"config": {"vehicle": {"mass_kg": 1.0}}}
        assert await vehicle.params() == flown.service.data


async def test_nobody_there_is_an_error_before_anything_is_sent(shared_broker: BrokerProcess) -> None:
    with pytest.raises(NoServiceError, match="no service of 'nobody' at"):
        async with connect("nobody", broker=f"mqtt://127.0.0.1:{shared_broker.port}"):
            pass
    with pytest.raises(NoServiceError, match="no broker at"):
        await connect(broker="mqtt://127.0.0.1:9")
    with pytest.raises(ConfigError, match="scheme http is not supported"):
        connect(broker="http://near")


async def test_a_time_limit_ends_the_wait_and_says_so_whether_of_the_call_or_the_vehicle(
    shared_broker: BrokerProcess,
) -> None:
    async with flying(shared_broker, Flight()) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        with pytest.raises(TimedOutError, match=r"goto: not over after 0\.2 s; it goes on; now: phase"):
            await vehicle.goto((0.0, 0.0, 1.0), timeout_s=0.2)
        vehicle.timeout_s = 0.2
        with pytest.raises(TimeoutError, match=r"what was waited for did not come in 0\.2 s; now: phase"):
            await vehicle.wait_until(lambda state: state.phase == "never")
        await moves(vehicle)
    assert flown.verbs == ["goto"]


async def test_an_error_of_the_condition_is_its_own(shared_broker: BrokerProcess) -> None:
    def fails(_: State) -> bool:
        raise TimeoutError("the condition's")

    async with flying(shared_broker, Flight()) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        with pytest.raises(TimeoutError, match=r"^the condition's$"):
            await vehicle.wait_until(fails, timeout_s=5.0)


async def test_a_stream_of_a_silent_service_ends_with_an_error(shared_broker: BrokerProcess) -> None:
    async with flying(shared_broker, Flight()) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        flown.service.silent = True
        with pytest.raises(NoServiceError, match=r"no state for 0\.3 s; "):
            async for _ in vehicle.states(silence_s=0.3):
                pass


async def test_progress_is_reported_while_a_command_is_under_way(shared_broker: BrokerProcess) -> None:
    steps: list[Progress] = []
    enough = asyncio.Event()

    def note(step: Progress) -> None:
        steps.append(step)
        if len(steps) == 3:
            enough.set()

    async def slowly(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, "it climbs"
        await enough.wait()
        yield Answer.DONE, "it hovers"

    async with flying(shared_broker, slowly) as flown, connect(flown.name, broker=flown.broker) as vehicle:
        vehicle.progress = note
        await vehicle.takeoff()
    assert {(one.verb, one.text) for one in steps} <= {("takeoff", ""), ("takeoff", "it climbs")}
    assert steps[-1].text == "it climbs"
    assert steps[-1].elapsed_s > steps[0].elapsed_s >= 0.0


async def test_without_a_block_the_connection_is_closed_by_hand_and_nothing_is_commanded(
    shared_broker: BrokerProcess,
) -> None:
    async with flying(shared_broker, Flight()) as flown:
        vehicle = await connect(flown.name, broker=flown.broker)
        await vehicle.arm()
        await vehicle.close()
        await vehicle.close()
    assert flown.verbs == ["arm"]


async def test_several_vehicles_fly_together_and_one_error_lands_all(shared_broker: BrokerProcess) -> None:
    async def script(left: Vehicle, right: Vehicle) -> None:
        assert await together(left.arm(), right.arm()) == ["arm is done", "arm is done"]
        await together(left.takeoff(), refused())

    async with flying(shared_broker, Flight()) as one, flying(shared_broker, Flight()) as two:

        async def fly() -> None:
            async with connect_all(one.name, two.name, broker=one.broker) as (left, right):
                await script(left, right)

        with pytest.raises(RejectedError, match="takeoff rejected: the battery is low"):
            await fly()
    assert one.verbs == ["arm", "takeoff", "abort"]
    assert two.verbs == ["arm", "abort"]


async def refused() -> str:
    raise RejectedError("takeoff", Reply(id="1", answer=Answer.REFUSED, time_s=0.0, text="the battery is low"))


async def test_errors_of_several_are_a_group() -> None:
    with pytest.raises(ExceptionGroup) as group:
        await together(refused(), refused())
    assert len(group.value.exceptions) == 2
