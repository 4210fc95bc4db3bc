"""A script that raises: what is landed, what is left alone, and that its own error stays the one that is seen."""

import asyncio
import logging
from collections.abc import Awaitable, Callable

import pytest

from companion.client import TimedOutError, Vehicle, connect, safe_exit
from companion.client.safe_exit import LandOnError
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer
from tests.broker import BrokerProcess, broker
from tests.client.flight import Flight, Flown, flying, moves
from tests.client.scripted import Answers, ScriptedService

pytestmark = pytest.mark.slow

Script = Callable[[Vehicle], Awaitable[None]]


async def run(script: Script, flown: Flown, land: LandOnError = True) -> None:
    """Run a script in `async with`."""
    async with connect(flown.name, broker=flown.broker, land_on_error=land) as vehicle:
        await script(vehicle)


async def flies_and_raises(vehicle: Vehicle) -> None:
    await vehicle.arm()
    await vehicle.takeoff()
    raise ValueError("the script's own")


async def moves_and_raises(vehicle: Vehicle) -> None:
    going = asyncio.ensure_future(vehicle.goto((0.0, 0.0, 1.0)))
    await moves(vehicle)
    going.cancel()
    raise KeyError


async def test_a_script_that_raises_lands_its_flight_and_keeps_its_error(shared_broker: BrokerProcess) -> None:
    async with flying(shared_broker, Flight()) as flown:
        with pytest.raises(ValueError, match="the script's own") as error:
            await run(flies_and_raises, flown)
    assert flown.verbs == ["arm", "takeoff", "abort"]
    assert not flown.service.armed
    assert error.value.__notes__ == [f'{flown.name}: landed because of ValueError("the script\'s own"): abort is done']
    assert error.traceback[-1].name == "flies_and_raises"


@pytest.mark.parametrize(
    ("land", "began", "sent"),
    [
        (True, False, ["goto", "hold"]),
        (True, True, ["arm", "goto", "abort"]),
        (False, True, ["arm", "goto"]),
        ("any", False, ["goto", "abort"]),
    ],
)
async def test_what_is_landed_is_what_the_script_began_or_what_it_was_told_to(
    shared_broker: BrokerProcess, land: LandOnError, began: bool, sent: list[str]
) -> None:
    async def script(vehicle: Vehicle) -> None:
        if began:
            await vehicle.arm()
        await moves_and_raises(vehicle)

    async with flying(shared_broker, Flight()) as flown:
        flown.service.armed = not began
        with pytest.raises(KeyError):
            await run(script, flown, land)
    assert flown.verbs == sent


async def test_a_vehicle_that_was_only_looked_at_is_left_alone(shared_broker: BrokerProcess) -> None:
    async def looks(vehicle: Vehicle) -> None:
        await vehicle.wait_until(lambda state: state.armed)
        await vehicle.hold()
        raise KeyError

    async with flying(shared_broker, Flight()) as flown:
        flown.service.armed = True
        with pytest.raises(KeyError) as error:
            await run(looks, flown)
    assert flown.verbs == ["hold"]
    assert not hasattr(error.value, "__notes__")


async def test_a_flight_that_the_script_has_landed_is_over(shared_broker: BrokerProcess) -> None:
    async def lands(vehicle: Vehicle) -> None:
        await vehicle.arm()
        await vehicle.wait_until(lambda state: state.armed)
        await vehicle.land()
        await vehicle.wait_until(lambda state: not state.armed)
        raise KeyError

    async with flying(shared_broker, Flight()) as flown:
        with pytest.raises(KeyError):
            await run(lands, flown)
    assert flown.verbs == ["arm", "land"]


async def test_a_pilot_who_has_taken_over_keeps_the_vehicle(shared_broker: BrokerProcess) -> None:
    async with flying(shared_broker, Flight()) as flown:

        async def loses_it(vehicle: Vehicle) -> None:
            await vehicle.arm()
            flown.service.phase = "handed over"
            await vehicle.wait_until(lambda state: state.phase == "handed over")
            raise KeyError

        with pytest.raises(KeyError) as error:
            await run(loses_it, flown)
    assert flown.verbs == ["arm"]
    assert "nothing was commanded: the autopilot or its pilot has the vehicle" in error.value.__notes__[0]


async def test_a_landing_that_has_begun_is_awaited_and_not_ordered_again(shared_broker: BrokerProcess) -> None:
    flight = Flight()
    flight.lands.clear()

    async def gives_up(vehicle: Vehicle) -> None:
        await vehicle.arm()
        asyncio.get_running_loop().call_later(0.5, flight.lands.set)
        await vehicle.land(timeout_s=0.2)

    async with flying(shared_broker, flight) as flown:
        with pytest.raises(TimedOutError) as error:
            await run(gives_up, flown)
    assert flown.verbs == ["arm", "land"]
    assert error.value.__notes__[0].endswith(": down and disarmed")


async def test_a_landing_that_fails_is_a_note_of_the_scripts_error(shared_broker: BrokerProcess) -> None:
    async def fails(service: ScriptedService, command: Command) -> Answers:
        yield Answer.ACCEPTED, ""
        service.armed = True
        yield (Answer.FAILED if command.verb == "abort" else Answer.DONE), "the autopilot is still armed"

    async with flying(shared_broker, fails) as flown:
        with pytest.raises(ValueError, match="the script's own") as error:
            await run(flies_and_raises, flown)
    assert error.value.__notes__ == [f"{flown.name}: NOT known to be safe: abort failed: the autopilot is still armed"]


async def test_a_broker_that_is_gone_is_waited_for_before_the_landing() -> None:
    with broker() as own:

        async def loses_the_broker(vehicle: Vehicle) -> None:
            await vehicle.arm()
            await asyncio.to_thread(own.stop)
            asyncio.get_running_loop().call_later(2.5, own.start)
            raise KeyError("in mid-air")

        async with flying(own, Flight()) as flown:
            with pytest.raises(KeyError) as error:
                await run(loses_the_broker, flown)
            assert flown.verbs == ["arm", "abort"]
            assert not flown.service.armed
    assert error.value.__notes__ == [f"{flown.name}: landed because of KeyError('in mid-air'): abort is done"]


async def test_a_broker_that_breaks_while_the_vehicle_lands_loses_neither() -> None:
    flight = Flight()
    flight.lands.clear()
    with broker() as own:

        async def break_it() -> None:
            await flight.begun["abort"].wait()
            await asyncio.to_thread(own.stop)
            flight.lands.set()
            await asyncio.to_thread(own.start)

        async with flying(own, flight) as flown:
            breaking = asyncio.create_task(break_it())
            with pytest.raises(ValueError, match="the script's own") as error:
                await run(flies_and_raises, flown)
            await breaking
    assert flown.verbs[:3] == ["arm", "takeoff", "abort"]
    assert not flown.service.armed
    assert "landed because of ValueError" in error.value.__notes__[0]


async def test_a_broker_that_stays_away_is_given_up_with_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(safe_exit, "_REACH_S", 0.5)
    with broker() as own:

        async def loses_the_broker(vehicle: Vehicle) -> None:
            await vehicle.arm()
            await asyncio.to_thread(own.stop)
            raise KeyError

        async with flying(own, Flight()) as flown:
            with pytest.raises(KeyError) as error:
                await run(loses_the_broker, flown)
    assert "NOT known to be safe: no service" in error.value.__notes__[0]


async def test_a_cancellation_lands_and_a_second_one_ends_the_wait_but_not_the_landing(
    shared_broker: BrokerProcess, caplog: pytest.LogCaptureFixture
) -> None:
    flight = Flight()
    flight.lands.clear()

    async def goes(vehicle: Vehicle) -> None:
        await vehicle.arm()
        await vehicle.goto((0.0, 0.0, 1.0))

    async with flying(shared_broker, flight) as flown:
        running = asyncio.create_task(run(goes, flown))
        for verb in ("goto", "abort"):
            async with asyncio.timeout(20.0):
                await flight.begun[verb].wait()
            running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
    assert "landing because of an interruption; Ctrl-C ends the wait" in caplog.text
    assert "interrupted again: not waiting; now: phase" in caplog.text
    assert "Traceback" not in caplog.text, "there was no error"
    assert flown.verbs == ["arm", "goto", "abort"]


async def test_the_scripts_own_error_is_logged_when_the_landing_is_not_waited_for(
    shared_broker: BrokerProcess, caplog: pytest.LogCaptureFixture
) -> None:
    flight = Flight()
    flight.lands.clear()
    async with flying(shared_broker, flight) as flown:
        running = asyncio.create_task(run(flies_and_raises, flown))
        async with asyncio.timeout(20.0):
            await flight.begun["abort"].wait()
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running
    assert "Traceback" in caplog.text
    assert "ValueError: the script's own" in caplog.text


async def test_a_script_that_leaves_its_vehicle_in_the_air_is_told_so(
    shared_broker: BrokerProcess, caplog: pytest.LogCaptureFixture
) -> None:
    async def forgets(vehicle: Vehicle) -> None:
        await vehicle.arm()
        await vehicle.wait_until(lambda state: state.armed)

    async with flying(shared_broker, Flight()) as flown:
        await run(forgets, flown)
    assert flown.verbs == ["arm"]
    assert [one.levelno for one in caplog.records] == [logging.WARNING]
    assert f"{flown.name}: the script ends, the vehicle does not: now: phase hold, armed" in caplog.text
