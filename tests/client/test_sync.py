"""The client without asyncio: the same names and types, and Ctrl-C in scripts of both forms."""

import asyncio
import inspect
import sys
import threading

import numpy as np
import pytest

from companion.client import FailedError, State, connecting, sync, view
from companion.client import vehicle as asynchronous
from companion.client.tasks import end
from companion.protocol.telemetry import Kind
from tests import warm
from tests.broker import BrokerProcess
from tests.client.flight import Flight, Flown, flying
from tests.client.scripted import done

pytestmark = pytest.mark.slow

_NOT_FOR_SCRIPTS = {"carry_out"}


def public(kind: type) -> set[str]:
    return {name for name, _ in inspect.getmembers(kind) if not name.startswith("_")} - _NOT_FOR_SCRIPTS


def test_the_twins_have_the_same_names_and_parameters() -> None:
    attributes = {"timeout_s", "progress", "arms"}
    assert public(sync.Vehicle) | {"arms"} == public(asynchronous.Vehicle) | attributes
    assert public(sync.Arms) == public(asynchronous.Arms)
    pairs = ((sync.Vehicle, asynchronous.Vehicle), (sync.Arms, asynchronous.Arms))
    for twin, original in pairs:
        for name, method in inspect.getmembers(original, inspect.isfunction):
            if name in public(original):
                assert inspect.signature(getattr(twin, name)).parameters == inspect.signature(method).parameters, name
    for name in ("connect", "connect_all", "vehicles"):
        assert inspect.signature(getattr(sync, name)).parameters == (
            inspect.signature(getattr(connecting, name)).parameters
        )


def test_the_attributes_of_a_twin_have_the_types_of_the_original() -> None:
    for name, attribute in inspect.getmembers(view.VehicleView, lambda value: isinstance(value, property)):
        twin = inspect.getattr_static(sync.Vehicle, name)
        written = twin.__orig_class__.__args__[0]
        returned = inspect.signature(attribute.fget).return_annotation
        assert returned in {written, "Array"}, name


async def test_commands_states_and_events_without_asyncio(shared_broker: BrokerProcess) -> None:
    def script(flown: Flown) -> None:
        with sync.connect(flown.name, broker=flown.broker) as vehicle:
            assert vehicle.takeoff(1.5) == "takeoff is done"
            vehicle.goto(np.array([0.5, 0.0, 1.0]))
            assert vehicle.arms.play("swing") == "arms is done"
            state = vehicle.wait_until(lambda state: state.phase == "standby", timeout_s=5.0)
            assert isinstance(state, State)
            assert vehicle.state.phase == "standby"
            assert np.array_equal(vehicle.position_w_m, np.zeros(3))
            vehicle.timeout_s = 7.0
            assert vehicle.timeout_s == 7.0
            for number, state in enumerate(vehicle.states()):
                assert state.controller == "etnn"
                if number == 1:
                    break
            assert next(event.name for event in vehicle.events()) == "mocap late"

    async with flying(shared_broker, done) as flown:
        telling = asyncio.create_task(tell_again_and_again(flown))
        await asyncio.to_thread(script, flown)
        await end(telling)
    assert flown.verbs == ["takeoff", "goto", "arms"]
    assert not [thread for thread in threading.enumerate() if thread.name == "companion.client"]


async def test_two_vehicles_together_without_asyncio(shared_broker: BrokerProcess) -> None:
    def script(one: Flown, two: Flown) -> None:
        with sync.connect_all(one.name, two.name, broker=one.broker) as (left, right):
            assert sync.together(left.arm, right.arm) == ["arm is done", "arm is done"]
            holding = threading.Timer(0.3, right.hold)
            holding.start()
            try:
                sync.together(left.takeoff, lambda: right.goto((0.0, 0.0, 1.0)))
            finally:
                holding.join()  # its answer may come after that of what it has ended

    async with flying(shared_broker, Flight()) as one, flying(shared_broker, Flight()) as two:
        with pytest.raises(FailedError, match="goto failed: ended by another command") as error:
            await asyncio.to_thread(script, one, two)
    assert one.verbs == ["arm", "takeoff", "abort"]
    assert two.verbs == ["arm", "goto", "hold", "abort"]
    assert len(error.value.__notes__) == 2


async def tell_again_and_again(flown: Flown) -> None:
    while True:
        await flown.service.tell(Kind.FAULT, "old", "mocap late")
        await asyncio.sleep(0.1)


async def begin(form: str, flown: Flown) -> asyncio.subprocess.Process:
    return await warm.create_process(
        sys.executable, "-m", "tests.client.interrupted", form, flown.name, flown.broker, stderr=asyncio.subprocess.PIPE
    )


@pytest.mark.parametrize("form", ["asyncio", "sync"])
async def test_ctrl_c_lands_and_the_script_ends_as_interrupted(shared_broker: BrokerProcess, form: str) -> None:
    flight = Flight()
    async with flying(shared_broker, flight) as flown:
        process = await begin(form, flown)
        await flight.begun["goto"].wait()
        process.send_signal(2)
        _, said = await process.communicate()
    assert flown.verbs == ["arm", "goto", "abort"]
    assert not flown.service.armed
    assert b"landing because of an interruption; Ctrl-C ends the wait, not the landing" in said
    assert b"landed because of an interruption: abort is done" in said
    assert said.rstrip().splitlines()[-1].startswith((b"KeyboardInterrupt", flown.name.encode()))


@pytest.mark.parametrize("form", ["asyncio", "sync", "raises"])
async def test_ctrl_c_while_landing_leaves_at_once_and_the_landing_goes_on(
    shared_broker: BrokerProcess, form: str
) -> None:
    flight = Flight()
    flight.lands.clear()
    async with flying(shared_broker, flight) as flown:
        process = await begin(form, flown)
        if form != "raises":
            await flight.begun["goto"].wait()
            process.send_signal(2)
        await flight.begun["abort"].wait()
        process.send_signal(2)
        _, said = await process.communicate()
        assert flown.service.phase == "land", "it goes on"
    assert b"interrupted again: not waiting; now: phase" in said
    assert b"KeyboardInterrupt" in said
    assert (b"ValueError: the script's own" in said) == (form == "raises")
