"""The link of a preflight without a service, over sockets: a ground law connects, and everything is measured."""

import math
from collections.abc import Callable
from pathlib import Path

from companion.adapters.law_link.udp import GroundLink, open_ground_link
from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.law_link.link_status import LinkStatus
from companion.law_link.messages import UpFlags
from companion.preflight.link_observer import open_link_observer
from tests.law_link.local import cycling, split_config, until


async def when(status: Callable[[], LinkStatus], true: Callable[[LinkStatus], bool]) -> LinkStatus:
    await until(lambda: true(status()))
    return status()


async def test_a_ground_law_is_seen_and_measured_before_a_service_runs(tmp_path: Path) -> None:
    config = split_config(tmp_path)
    async with (
        open_link_observer(config) as link,
        open_ground_link(config, "pid", MonotonicClock()) as ground,
    ):
        assert link is not None
        assert not link.status().connected
        assert link.poses.latest_pose() is None
        status = link.status
        async with cycling(ground.send_due):
            await sees_and_measures(status, ground)


async def sees_and_measures(status: Callable[[], LinkStatus], ground: GroundLink) -> None:
    seen = await when(status, lambda link: math.isfinite(link.age_s) and math.isfinite(link.round_trip_s))
    assert (seen.law, seen.blind, seen.foreign) == ("pid", False, 0)
    assert abs(seen.age_s) < 0.1
    assert seen.silence_s < 1.0
    ground.end.flags = UpFlags.BLIND
    assert (await when(status, lambda link: link.blind)).connected


async def test_a_law_on_board_has_no_link() -> None:
    async with open_link_observer(CompanionConfig()) as status:
        assert status is None
