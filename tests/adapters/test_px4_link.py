"""Who is on the link: other autopilots, several batteries, and texts of any bytes; against a fake PX4 over UDP."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from companion.adapters.clock import MonotonicClock
from companion.adapters.px4 import Px4, open_px4
from companion.config_px4 import Px4Config
from companion.ports import AutopilotError
from tests.adapters.fake_px4 import FakePx4, battery, text

ARDUPILOT = 3


@asynccontextmanager
async def linked(fake: FakePx4, **changes: Any) -> AsyncIterator[Px4]:
    config = Px4Config(**{"url": fake.url, "connect_timeout_s": 5.0, "answer_timeout_s": 2.0} | changes)
    async with open_px4(config, MonotonicClock()) as px4:
        yield px4


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(10.0):
        while not true():  # noqa: ASYNC110 - MAVSDK's thread tells nobody
            await asyncio.sleep(0.01)


async def test_a_second_battery_neither_lands_the_vehicle_nor_hides_an_empty_one() -> None:
    with FakePx4() as fake:
        fake.repeated += [battery(0, 90, 15.8), battery(1, 12, 10.9)]
        async with linked(fake) as px4:
            await until(lambda: len(px4.status().batteries) == 2)
            assert (px4.status().battery_id, px4.status().battery_fraction) == (0, 0.9)
        async with linked(fake, battery_id=1) as px4:
            await until(lambda: px4.status().battery_fraction == 0.12)
            assert px4.status().battery_v == pytest.approx(10.9)


async def test_a_text_that_is_no_utf_8_is_kept_without_what_a_terminal_would_obey(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with FakePx4() as fake:
        async with linked(fake) as px4:
            fake.to_send.append(text(b"\xe9\xff cold \x1b[31m"))
            await until(lambda: bool(px4.status().last_text))
            assert px4.status().last_text == "\ufffd\ufffd cold \ufffd[31m"
    assert "\x1b" not in "".join(capfd.readouterr())


async def test_a_long_text_whose_end_is_lost_is_told_without_it() -> None:
    with FakePx4() as fake:
        async with linked(fake) as px4:
            fake.to_send.append(text(b"x" * 50, 9))
            await until(lambda: px4.status().last_text == "x" * 50)


async def test_another_autopilot_than_px4_is_named_at_once() -> None:
    says = "is not PX4 but ArduPilot: this service flies PX4 alone"
    with FakePx4(autopilot=ARDUPILOT) as fake, pytest.raises(AutopilotError, match=says):
        async with linked(fake):
            pass


async def test_the_configured_system_is_flown_also_when_another_is_heard_first() -> None:
    with FakePx4(system=2) as other, FakePx4(other.port, system=1):
        async with linked(other, system_id=1) as px4:
            assert px4.status().system_id == 1
            await until(lambda: px4.status().strangers == ("system 2 (PX4)",))


async def test_a_configured_system_that_is_not_there_is_told_with_those_that_are() -> None:
    says = r"px4.system_id = 7 was not heard .*, only system 2: set px4.system_id"
    with FakePx4(system=2) as fake, pytest.raises(AutopilotError, match=says):
        async with linked(fake, system_id=7, connect_timeout_s=2.0):
            pass
