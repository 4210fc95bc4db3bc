"""Services of several vehicles on one broker: they know of each other, and two that fly one body say so."""

import logging
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import pytest

from companion.adapters.mqtt.link import BusLink
from companion.config.operator_config import OperatorConfig
from companion.protocol.about import About, AboutFence, AboutRoom
from companion.protocol.intent import Intent
from tests.adapters.mqtt.rig import CLOCK, Vehicle, until
from tests.broker import BrokerProcess, broker

pytestmark = pytest.mark.slow

_SPACE: dict[str, Any] = {"x_m": (-2.0, 2.0), "y_m": (-2.0, 2.0)}


def about(body: str, session: str) -> About:
    return About(
        session=session, body=body, takeoff_height_m=1.0, footprint_m=0.5,
        fence=AboutFence(**_SPACE, top_m=3.0), room=AboutRoom(**_SPACE, z_m=(0.2, 2.5)),
    )  # fmt: skip


@asynccontextmanager
async def vehicle(there: BrokerProcess, name: str, body: str) -> AsyncIterator[BusLink]:
    session = name[-1] * 16
    link = BusLink(OperatorConfig(port=there.port, vehicle=name), CLOCK, session, about(body, session))
    async with link.listening(Vehicle().on_command):
        await link.listened(15.0)
        yield link


def intent(session: str, x_m: float) -> Intent:
    return Intent(session=session * 16, body="one", verb="goto", from_s=1.0, knots=((0.0, x_m, 0.0, 1.0),))


async def test_two_vehicles_that_fly_one_body_both_say_so_until_one_ends(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR)
    with broker() as there:
        async with vehicle(there, "v-1", "one") as first, AsyncExitStack() as ends:
            other = await ends.enter_async_context(vehicle(there, "v-2", "two"))
            await until(first.neighbours.present)
            assert (first.rival(), other.rival()) == ("", "")
            third = await ends.enter_async_context(vehicle(there, "v-3", "one"))
            for link in (third, first):
                await until(link.rival)
            assert other.rival() == ""
            assert third.rival().startswith("another service flies the same body in QTM, 'one': vehicle 'v-1', on ")
            assert third.rival().endswith("stop one of the two, or give each its own [mocap] body")
            await ends.aclose()
            await until(lambda: not first.rival())
    assert len([one for one in caplog.records if "the same body" in one.getMessage()]) == 2


async def test_an_announced_way_reaches_the_others_and_ends_with_its_service() -> None:
    with broker() as there:
        async with vehicle(there, "v-1", "one") as first:
            first.announce(intent("1", 1.0))
            async with vehicle(there, "v-2", "two") as second:  # which comes later
                await until(second.neighbours.intents)
                assert second.neighbours.intents() == (intent("1", 1.0),)
                first.announce(intent("1", 2.0))
                await until(lambda: second.neighbours.intents() == (intent("1", 2.0),))
                first.announce(None)
                await until(lambda: not second.neighbours.intents())
                first.announce(intent("9", 3.0))  # of an earlier run
                first.announce(intent("1", 4.0))
                await until(second.neighbours.intents)
                assert second.neighbours.intents() == (intent("1", 4.0),)
                assert first.neighbours.intents() == ()
                async with vehicle(there, "v-3", "three") as third:
                    await until(third.neighbours.intents)


async def test_what_is_no_message_is_ignored_and_a_kept_status_is_nobody(caplog: pytest.LogCaptureFixture) -> None:
    from tests.client.scripted import Client

    with broker() as there:
        async with vehicle(there, "v-1", "one") as link, Client("127.0.0.1", there.port) as stranger:
            for topic, payload in (
                ("dauam/v1/v-2/intent", "{"),
                ("dauam/v1/v-2/status", "[]"),
                ("dauam/v1/no.name/status", '{"online": true, "body": "one"}'),
            ):
                await stranger.publish(topic, payload, qos=1)
            await stranger.publish("dauam/v1/v-4/status", '{"online": true, "body": "one"}', qos=1, retain=True)
            async with vehicle(there, "v-5", "one") as late:  # hears the kept status, and the first vehicle
                await until(late.rival)
                assert {one.vehicle for one in late.neighbours.present()} == {"v-1"}
            assert link.neighbours.intents() == ()
    assert "Traceback" not in caplog.text
