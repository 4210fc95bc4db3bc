"""The mock QTM and the adapter, connected over real sockets on free ports, with time in the tests' hands."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Literal

import numpy as np

from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.qualisys.source import QualisysSource
from companion.config.mocap_config import MocapConfig
from mock_autopilot.physics.quaternion import Array
from mock_autopilot.physics.truth import Truth
from mock_autopilot.qtm.config import Interval, QualisysConfig
from mock_autopilot.qtm.server import QualisysServer

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
FAR_S = 1e6
"""Distance from which the mock's body is lost; a lost frame is one captured there."""


class ManualClock:
    """`interfaces.Clock` that stands still until told."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def now_s(self) -> float:
        return self.time_s


class QualisysRig:
    """`mocap_contract.Rig` over the mock server."""

    def __init__(self, server: QualisysServer, source: QualisysSource, clock: ManualClock, frames: int) -> None:
        self.server = server
        self.source = source
        self.port = server.port
        self._clock = clock
        self._frames = frames

    def capture(
        self,
        position_w_m: tuple[float, float, float] = (0.0, 0.0, 1.0),
        tracked: bool = True,
        q_ned_frd_wxyz: Array = LEVEL,
    ) -> float:
        self._frames += 1
        outages = () if tracked else (Interval(start_s=0.0, for_s=FAR_S),)
        self.server._camera.config = self.server.config.model_copy(update={"outages": outages})
        return publish(self.server, self._frames, position_w_m, q_ned_frd_wxyz)

    def set_clock(self, now_s: float) -> None:
        self._clock.time_s = now_s

    async def end(self) -> None:
        await self.server.stop()


def publish(
    server: QualisysServer,
    number: int,
    position_w_m: tuple[float, float, float] = (0.0, 0.0, 1.0),
    q_ned_frd_wxyz: Array = LEVEL,
) -> float:
    """Publish the true state at a capture; W has z up and x north, so NED is (x, -y, -z)."""
    x, y, z = position_w_m
    server.publish(
        Truth(number * 0.01, np.array([x, -y, -z]), np.zeros(3), q_ned_frd_wxyz, np.zeros(3), on_ground=False)
    )
    return number * 0.01


@asynccontextmanager
async def serving(**settings: Any) -> AsyncIterator[QualisysServer]:
    """Run a mock QTM on a free port, by default without noise and delay."""
    quiet: dict[str, Any] = {"port": 0, "noise_m": 0.0, "noise_rad": 0.0, "delay_s": 0.0}
    server = QualisysServer(QualisysConfig(**(quiet | settings)), seed=1)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


@asynccontextmanager
async def capturing(server: QualisysServer) -> AsyncIterator[list[int]]:
    """Capture frames while open; the list holds the number of the newest."""
    newest = [0]

    async def flow() -> None:
        while True:
            newest[0] += 1
            publish(server, newest[0])
            await asyncio.sleep(0.002)

    task = asyncio.create_task(flow(), name="frames")
    try:
        yield newest
    finally:
        task.cancel()
        await asyncio.wait([task])


def settings_for(server: QualisysServer, **settings: Any) -> MocapConfig:
    """Return the adapter's settings for this server, with generous time-outs."""
    return MocapConfig(**({"port": server.port, "connect_timeout_s": 5.0, "first_frame_timeout_s": 5.0} | settings))


@asynccontextmanager
async def qualisys_rig(transport: Literal["tcp", "udp"], **settings: Any) -> AsyncIterator[QualisysRig]:
    """Yield a connected server and adapter once all frames of the start were received."""
    clock = ManualClock()
    async with serving(**settings) as server:
        async with capturing(server) as newest:
            opening = open_qualisys(settings_for(server, transport=transport), clock)
            source = await opening.__aenter__()
        try:
            while await source.wait_frame(0.03):
                pass
            yield QualisysRig(server, source, clock, newest[0])
        finally:
            await opening.__aexit__(None, None, None)
