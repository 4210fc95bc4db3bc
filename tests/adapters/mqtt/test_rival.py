"""Two services of one vehicle's name on one broker: both say so, whichever was first."""

import asyncio
import logging
import re
from collections.abc import Iterator
from contextlib import AsyncExitStack

import pytest

from companion.adapters.mqtt import link as link_module
from companion.adapters.mqtt.link import BusLink
from companion.adapters.mqtt.rival import Rival
from companion.config.operator_config import OperatorConfig
from tests.adapters.mqtt.rig import CLOCK, TOPICS, Vehicle, operating, until
from tests.broker import BrokerProcess, broker

pytestmark = pytest.mark.slow

_SENTENCE = (
    r"another service has this vehicle's name \(dauam/v1/vehicle at 127.0.0.1:\d+\): on \S+, version .* stop one"
)


@pytest.fixture(scope="module")
def served() -> Iterator[BrokerProcess]:
    with broker() as process:
        yield process


async def opened(stack: AsyncExitStack, port: int, session: str) -> BusLink:
    """Open a link that has searched for another service."""
    config = OperatorConfig(port=port)
    link = BusLink(config, CLOCK, session * 16)
    await stack.enter_async_context(link.listening(Vehicle().on_command))
    await link.listened(15.0)
    return link


async def test_the_second_hears_the_first_before_it_says_anything_and_both_say_so(
    served: BrokerProcess, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.ERROR)
    async with AsyncExitStack() as first_ends, operating(served.port) as operator:
        first = await opened(first_ends, served.port, "a")
        assert first.rival() == ""
        async with AsyncExitStack() as second_ends:
            second = await opened(second_ends, served.port, "b")
            assert not any(said.json.get("session") == "b" * 16 for said in operator.heard)
            for link in (second, first):
                await until(link.rival)
    said_aloud = [record.getMessage() for record in caplog.records]
    assert len(said_aloud) == 2
    assert all(re.match(_SENTENCE, one) for one in said_aloud)


async def test_a_run_that_is_over_is_no_other_service(served: BrokerProcess) -> None:
    """The broker still has its status, or its last will."""
    for session in "cd":
        async with AsyncExitStack() as ends:
            link = await opened(ends, served.port, session)
            async with operating(served.port) as operator:
                await operator.hears(TOPICS.status, online=True, session=session * 16)
            assert link.rival() == ""


async def test_without_a_broker_nobody_is_waited_for_long() -> None:
    config = OperatorConfig(port=9)
    link = BusLink(config, CLOCK, "e" * 16)
    async with link.listening(Vehicle().on_command):
        await link.listened(0.1)
        assert link.rival() == ""


async def test_a_broker_that_keeps_our_own_status_from_us_is_told(
    served: BrokerProcess, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """mosquitto refuses no subscription that its list of topics forbids: only nothing comes."""
    monkeypatch.setattr(link_module, "_BEAT_S", 0.01)
    async with AsyncExitStack() as ends:
        link = await opened(ends, served.port, "f")
        await until(lambda: link.age_s() == 0.0)
        await asyncio.sleep(0.5)
        assert "would not be noticed" not in caplog.text
    monkeypatch.setattr(Rival, "note", lambda *_: False)
    async with AsyncExitStack() as ends:
        await opened(ends, served.port, "f")
        await until(lambda: "would not be noticed" in caplog.text)
