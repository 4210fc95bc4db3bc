"""Orders over a real broker, and what becomes of the link when the broker is not there, goes, hangs or comes back."""

import asyncio
import json
import time
from collections.abc import Iterator

import aiomqtt
import pytest

from companion.operator_orders import Order, OrderKind
from companion.ports import FlightError
from companion.supervisor.safety import SafetyRules
from tests.adapters.mqtt_rig import ORDER, STATUS, Vehicle, linked, open_files, operated, operating, ticking, until
from tests.adapters.qtm_scripts import Silent, listening
from tests.broker import BrokerProcess, broker

pytestmark = pytest.mark.realtime

BLOCKED_S = 0.5
"""Every time-out of the link is longer: a loop that waited one out would show."""


@pytest.fixture(scope="module")
def running() -> Iterator[BrokerProcess]:
    with broker() as process:
        yield process


async def test_orders_reach_the_vehicle(running: BrokerProcess) -> None:
    vehicle = Vehicle()
    async with operated(running.port, vehicle) as (_, operator):
        for kind in OrderKind:
            confirmed = {"confirm": "kill"} if kind is OrderKind.KILL else {}
            name = await operator.order(kind, **confirmed)
            await until(lambda name=name, kind=kind: vehicle.orders[-1:] == [Order(kind, name)])  # type: ignore[misc]
        assert len(vehicle.orders) == len(OrderKind)


async def test_what_is_refused_changes_nothing_and_the_operator_is_told(running: BrokerProcess) -> None:
    vehicle = Vehicle()
    async with operated(running.port, vehicle) as (_, operator):
        await operator.order("kill")
        assert 'needs "confirm": "kill"' in (await operator.refusal())["reason"]
        await operator.order("land", id="late", sent_s=time.time() - 6.0)
        late = await operator.refusal()
        assert (late["id"], late["reason"][:5]) == ("late", "sent ")
        await operator.say(b"\x00" * 5000)
        assert (await operator.refusal())["reason"] == "5000 bytes are no order: at most 4096"
        assert vehicle.orders == []
        await operator.order("hold", id="twice")
        await operator.order("hold", id="twice")
        assert await operator.refusal() == {"id": "twice", "reason": "this id was taken already"}
        assert vehicle.orders == [Order(OrderKind.HOLD, "twice")]


async def test_what_the_flight_cannot_do_is_a_refusal_and_a_defect_of_it_no_end(running: BrokerProcess) -> None:
    vehicle = Vehicle()
    async with operated(running.port, vehicle) as (link, operator):
        vehicle.error = FlightError("cannot resume in phase standby")
        name = await operator.order("resume")
        assert await operator.refusal() == {"id": name, "reason": "cannot resume in phase standby"}
        vehicle.error = ZeroDivisionError()
        name = await operator.order("hold")
        assert await operator.refusal() == {"id": name, "reason": "failed: ZeroDivisionError"}
        vehicle.error = None
        await operator.order("abort")
        await until(lambda: vehicle.orders[-1].kind is OrderKind.ABORT)
        assert link.age_s() == 0.0


async def test_an_abort_comes_through_a_flood(running: BrokerProcess) -> None:
    vehicle = Vehicle()
    async with operated(running.port, vehicle) as (_, operator):
        async with ticking() as longest_s:
            for _ in range(300):
                await operator.say(b"\xff" * 100)
            await operator.order("abort")
            await until(lambda: vehicle.orders)
        assert longest_s[0] < BLOCKED_S


async def test_everyone_sees_whether_the_vehicle_listens(running: BrokerProcess) -> None:
    async with linked(running.port, Vehicle()) as link:
        await until(lambda: link.age_s() == 0.0)
        async with operating(running.port) as late_comer:
            await until(lambda: (STATUS, b"online") in late_comer.heard)
    async with operating(running.port) as afterwards:
        await until(lambda: (STATUS, b"offline") in afterwards.heard)


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
                    await until(lambda round_trip=round_trip: len(vehicle.orders) == round_trip)  # type: ignore[misc]
                await asyncio.to_thread(process.stop)
                await until(lambda: link.age_s() > 0.0)
            assert longest_s[0] < BLOCKED_S
    finally:
        process.stop()


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
                await until(lambda: vehicle.orders)
            assert longest_s[0] < BLOCKED_S


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


async def test_an_order_that_a_broker_has_kept_is_never_obeyed(running: BrokerProcess) -> None:
    """Kill and abort count at any age: one that was published to stay would end every flight anew."""
    vehicle = Vehicle()
    kept = json.dumps({"order": "abort", "id": "kept", "sent_s": time.time()}).encode()
    async with aiomqtt.Client("127.0.0.1", running.port) as client:
        await client.publish(ORDER, kept, qos=1, retain=True)
    async with operated(running.port, vehicle) as (_, operator):
        name = await operator.order("hold")
        await until(lambda: vehicle.orders)
        assert vehicle.orders == [Order(OrderKind.HOLD, name)]
    async with aiomqtt.Client("127.0.0.1", running.port) as client:
        await client.publish(ORDER, b"", qos=1, retain=True)
