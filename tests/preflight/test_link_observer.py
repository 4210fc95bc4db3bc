"""The link of a preflight without a service, over sockets: a ground law connects, and everything is measured."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.adapters.law_link.udp import open_ground_link
from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import LawConfig, LawLinkConfig
from companion.law_link.link_status import LinkStatus
from companion.law_link.messages import UpFlags
from companion.preflight.link_observer import open_link_observer
from tests.ports import free_port

_CYCLE_S = 0.01
_PATIENCE_S = 10.0


@pytest.fixture
def config(tmp_path: Path) -> CompanionConfig:
    key = tmp_path / "law.key"
    key.write_text("0123456789abcdef0123456789abcdef\n")
    key.chmod(0o600)
    link = LawLinkConfig(port=free_port(), listen="127.0.0.1", key_file=str(key))
    return CompanionConfig(law=LawConfig(runs_on="ground", link=link))


async def when(status: Callable[[], LinkStatus], true: Callable[[LinkStatus], bool]) -> LinkStatus:
    async with asyncio.timeout(_PATIENCE_S):
        while True:
            link = status()
            if true(link):
                return link
            await asyncio.sleep(_CYCLE_S)


async def test_a_ground_law_is_seen_and_measured_before_a_service_runs(config: CompanionConfig) -> None:
    async with open_link_observer(config) as link, open_ground_link(config, "pid", MonotonicClock()) as ground:
        assert link is not None
        status = link.status
        assert not status().connected
        assert link.poses.latest_pose() is None

        async def cycles() -> None:
            while True:
                ground.send_due()
                await asyncio.sleep(_CYCLE_S)

        law = asyncio.create_task(cycles())
        try:
            seen = await when(status, lambda link: math.isfinite(link.age_s) and math.isfinite(link.round_trip_s))
            assert (seen.law, seen.blind, seen.foreign) == ("pid", False, 0)
            assert abs(seen.age_s) < 0.1
            assert seen.silence_s < 1.0
            ground.end.flags = UpFlags.BLIND
            assert (await when(status, lambda link: link.blind)).connected
        finally:
            law.cancel()


async def test_a_law_on_board_has_no_link() -> None:
    async with open_link_observer(CompanionConfig()) as status:
        assert status is None
