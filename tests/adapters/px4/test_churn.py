"""A link to PX4 that is closed at any instant, whatever PX4 does: no crash in native code, no wait that is held up."""

import asyncio
import time

import pytest

from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.config.px4_config import Px4Config
from companion.core.interfaces import AutopilotError
from tests.adapters.px4.churn import churn
from tests.adapters.px4.fake_px4 import FakePx4, acknowledgement

pytestmark = [pytest.mark.slow, pytest.mark.realtime]


def test_no_cycle_of_opening_and_closing_ends_the_process() -> None:
    done = churn(cycles=12, seed=3, jobs=4)
    assert set(done.exit_codes) == {0}, done.output
    assert done.outcomes["closed"] > 5, "most of them connected"


@pytest.mark.realtime
@pytest.mark.parametrize("leaves_after_s", [0.0, 0.3])
async def test_an_unanswered_command_does_not_hold_up_the_end_of_the_link(leaves_after_s: float) -> None:
    with FakePx4() as fake:
        config = Px4Config(url=fake.url, answer_timeout_s=5.0)
        async with open_px4(config, MonotonicClock()) as px4:
            fake.silent, fake.answers = True, 0.0
            arming = asyncio.create_task(px4.arm())
            await asyncio.sleep(leaves_after_s)
            arming.cancel()
            left_s = time.monotonic()
        assert time.monotonic() - left_s < 1.5


async def test_a_command_whose_answer_is_lost_is_sent_again_until_it_comes() -> None:
    with FakePx4() as fake:
        config = Px4Config(url=fake.url, answer_timeout_s=5.0)
        async with open_px4(config, MonotonicClock()) as px4:
            fake.answers = 0.0
            arming = asyncio.create_task(px4.arm())
            while len([one for one in fake.commands if one.command == 400]) < 2:  # noqa: ASYNC110 - a thread's list
                await asyncio.sleep(0.01)
            fake.answers = 1.0
            await arming
            confirmations = [one.confirmation for one in fake.commands if one.command == 400]
    assert confirmations == list(range(len(confirmations)))


async def test_a_command_that_nobody_waits_for_is_not_sent_again() -> None:
    with FakePx4() as fake:
        config = Px4Config(url=fake.url, answer_timeout_s=5.0)
        async with open_px4(config, MonotonicClock()) as px4:
            fake.answers = 0.0
            arming = asyncio.create_task(px4.arm())
            await asyncio.sleep(0.2)
            arming.cancel()
            await asyncio.sleep(1.0)
            sent = [one for one in fake.commands if one.command == 400]
    assert len(sent) == 1


async def test_an_acknowledgement_to_another_ground_station_is_not_ours() -> None:
    with FakePx4() as fake:
        config = Px4Config(url=fake.url, answer_timeout_s=1.0, arm_timeout_s=0.5)
        async with open_px4(config, MonotonicClock()) as px4:
            fake.answers = 0.0
            fake.repeated.append(acknowledgement(400, target=(255, 190)))
            with pytest.raises(AutopilotError, match="did not answer the command to arm"):
                await px4.arm()
