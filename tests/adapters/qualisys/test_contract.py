"""The contract over both transports, and what only a Qualisys can do."""

import asyncio
import logging
from collections.abc import AsyncIterator
from typing import Any, Literal

import numpy as np
import pytest
import pytest_asyncio
import uvloop

from tests.adapters.mocap.contract import ARRIVES_S, NOTHING_COMES_S, MocapContract
from tests.adapters.qualisys.rig import QualisysRig, capturing, qualisys_rig, serving

pytestmark = pytest.mark.realtime

MANY_ATTEMPTS_S = 0.5


class QualisysContract(MocapContract):
    """The contract, and the far side's own doings."""

    async def test_a_server_that_goes_away_is_silence_and_is_told_once(
        self, rig: QualisysRig, caplog: pytest.LogCaptureFixture
    ) -> None:
        await rig.end()
        before = rig.source.latest()
        assert not await rig.source.wait_frame(MANY_ATTEMPTS_S)
        assert rig.source.latest() is before
        told = [record.getMessage() for record in caplog.records if record.levelno == logging.ERROR]
        assert told == [f"no frames until QTM is back: QTM at 127.0.0.1:{rig.port} closed the connection"]

    async def test_a_server_that_comes_back_is_found_again_by_the_bodys_name(self, rig: QualisysRig) -> None:
        await rig.end()
        assert not await rig.source.wait_frame(NOTHING_COMES_S)
        async with serving(port=rig.port, body="wand", extra_bodies=("dauam",)) as server, capturing(server):
            assert await rig.source.wait_frame(ARRIVES_S)
            frame = rig.source.latest()
            assert frame is not None
            assert frame.position_w_m.tolist() == [1.0, 2.0, 0.0], "where the mock stands its first extra body"

    async def test_a_stopped_capture_is_silence_and_may_start_again(self, rig: QualisysRig) -> None:
        rig.server.stop_capture()
        rig.capture()
        assert not await rig.source.wait_frame(NOTHING_COMES_S)
        rig.server.start_capture()
        rig.capture()
        assert await rig.source.wait_frame(ARRIVES_S)

    async def test_skipped_frames_are_counted(self, rig: QualisysRig) -> None:
        before = rig.source.counts.lost
        rig.capture()
        rig.server.capturing = False
        for _ in range(3):
            rig.capture()
        rig.server.capturing = True
        rig.capture()
        while await rig.source.wait_frame(NOTHING_COMES_S):
            pass
        assert rig.source.counts.lost - before == 3

    @pytest.mark.parametrize(
        ("q_ned_frd", "body_axis", "expected_w", "because"),
        [
            ((np.cos(0.15), 0, np.sin(0.15), 0), 0, (np.cos(0.3), 0, np.sin(0.3)), "nose-up lifts the nose"),
            ((np.cos(0.15), np.sin(0.15), 0, 0), 1, (0, np.cos(0.3), np.sin(0.3)), "right roll lifts the left side"),
            ((np.cos(0.15), 0, 0, -np.sin(0.15)), 0, (np.cos(0.3), np.sin(0.3), 0), "yaw left turns the nose to west"),
            ((np.cos(0.15), 0, np.sin(0.15), 0), 2, (-np.sin(0.3), 0, np.cos(0.3)), "nose-up pushes backwards"),
            ((np.cos(0.15), np.sin(0.15), 0, 0), 2, (0, -np.sin(0.3), np.cos(0.3)), "right roll pushes to the east"),
        ],
    )
    async def test_attitudes_keep_their_sense(
        self, rig: QualisysRig, q_ned_frd: Any, body_axis: int, expected_w: Any, because: str
    ) -> None:
        """Nose 0.3 rad up, right side down, nose left: in W north is x, west is y, up is z."""
        rig.capture(q_ned_frd_wxyz=np.array(q_ned_frd, dtype=float))
        assert await rig.source.wait_frame(ARRIVES_S)
        frame = rig.source.latest()
        assert frame is not None
        np.testing.assert_allclose(frame.rotation_w_b[:, body_axis], expected_w, atol=1e-6, err_msg=because)

    async def test_all_that_was_sent_is_accounted_for(self, rig: QualisysRig) -> None:
        before = rig.source.counts
        for _ in range(20):
            rig.capture()
        while await rig.source.wait_frame(NOTHING_COMES_S):
            pass
        now = rig.source.counts
        assert now.received - before.received + now.lost - before.lost == 20
        assert (now.late, now.malformed) == (0, 0)


class TestQualisysOverTcp(QualisysContract):
    @pytest_asyncio.fixture
    async def rig(self) -> AsyncIterator[QualisysRig]:
        async with qualisys_rig("tcp", extra_bodies=("leader",)) as rig:
            yield rig


class TestQualisysOverUdp(QualisysContract):
    @pytest_asyncio.fixture
    async def rig(self) -> AsyncIterator[QualisysRig]:
        async with qualisys_rig("udp", extra_bodies=("leader",)) as rig:
            yield rig


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_it_flies_on_uvloop_too(transport: Literal["tcp", "udp"]) -> None:
    """The service runs on uvloop, whose transports are not asyncio's."""

    async def converse() -> bool:
        async with qualisys_rig(transport) as rig:
            rig.capture()
            arrived = await rig.source.wait_frame(ARRIVES_S)
            await rig.end()
            async with serving(port=rig.port) as server, capturing(server):
                return arrived and await rig.source.wait_frame(ARRIVES_S)

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        assert runner.run(converse())
