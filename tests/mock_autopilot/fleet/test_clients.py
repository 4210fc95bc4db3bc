"""Real clients of a fleet over loopback: MAVSDK by the adapter, qtm-rt by the source of frames, two of each."""

import asyncio
import random
import socket
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from companion.adapters.px4.link import open_px4
from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.system.clock import MonotonicClock
from companion.config.mocap_config import MocapConfig
from companion.config.px4_config import Px4Config
from companion.control.pipeline import idle_setpoint
from companion.core.types import FlightMode
from mock_autopilot.config import MockConfig
from mock_autopilot.simulator import Simulator
from tests.ports import free_port

pytestmark = pytest.mark.realtime
ROOT = Path(__file__).resolve().parents[3]
WITHIN_S = 8.0


def _two_free_udp_ports() -> int:
    """Return the first of two UDP ports in a row that are free now."""
    for port in random.sample(range(20_000, 32_000), 100):
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as next_one,
        ):
            try:
                one.bind(("", port))
                next_one.bind(("", port + 1))
            except OSError:
                continue
            return port
    raise AssertionError("no two free ports in a row")


def _two_vehicles(client_port: int) -> Simulator:
    config = MockConfig.load(ROOT / "config" / "mock.toml").model_dump()
    config["mavlink"] |= {"local_port": 0, "remote_port": client_port}
    config["qualisys"]["port"] = free_port()
    config["arms"]["enabled"] = False
    config["fleet"]["vehicles"] = 2
    return Simulator(MockConfig.from_dict(config), 1)


async def test_each_client_speaks_to_its_own_autopilot_and_sees_every_body() -> None:
    client_port, clock = _two_free_udp_ports(), MonotonicClock()
    async with _two_vehicles(client_port) as mock, AsyncExitStack() as clients, asyncio.timeout(WITHIN_S):
        assert mock.qualisys is not None
        autopilots, frames = [], []
        for number, body in enumerate(("dauam-1", "dauam-2")):
            px4 = Px4Config(url=f"udpin://127.0.0.1:{client_port + number}")
            autopilots.append(await clients.enter_async_context(open_px4(px4, clock)))
            mocap = MocapConfig(host="127.0.0.1", port=mock.qualisys.port, body=body)
            others = [name for name in ("dauam-1", "dauam-2") if name != body]
            frames.append(await clients.enter_async_context(open_qualisys(mocap, clock, others)))
        first, second = (source.latest() for source in frames)
        assert first is not None
        assert second is not None
        assert first.position_w_m.tolist() == pytest.approx([0.0, -0.8, 0.0], abs=0.01)
        assert second.position_w_m.tolist() == pytest.approx([0.0, 0.8, 0.0], abs=0.01)
        assert first.others[0].body == "dauam-2"
        assert first.others[0].position_w_m == pytest.approx([0.0, 0.8, 0.0], abs=0.01)
        autopilots[1].send_setpoint(idle_setpoint(0.0))
        await asyncio.sleep(0.1)
        await autopilots[1].start_offboard()
        assert [one.status().mode for one in autopilots] == [FlightMode.HOLD, FlightMode.OFFBOARD]
        assert [one.status().system_id for one in autopilots] == [1, 2]
