"""The PX4 adapter and the mock on either end of a link."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np

from companion.adapters.px4.autopilot import Px4
from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.cli.demo.mock_process import MockPorts, free_ports
from companion.config.px4_config import Px4Config
from companion.control.pipeline import idle_setpoint
from companion.geometry.frames import quat_from_yaw
from mock_autopilot.config import MockConfig
from mock_autopilot.simulator import Simulator

ROOT = Path(__file__).resolve().parents[3]
START_NED_M = (0.8, -0.5, 0.0)
START_YAW_NED_RAD = -1.0


def standing_off_the_origin(ports: MockPorts | None = None) -> tuple[Simulator, str]:
    """Run a mock without cameras and arms; yield it and its address."""
    ports = ports or free_ports()
    config = MockConfig.load(ROOT / "config" / "mock.toml").model_dump()
    config["mavlink"] |= {"local_port": ports.autopilot, "remote_port": ports.client}
    config["vehicle"] |= {"start_position_ned_m": START_NED_M, "start_yaw_rad": START_YAW_NED_RAD}
    config["arms"]["enabled"] = False
    return Simulator(MockConfig.from_dict(config), 1, with_qualisys=False), f"udpin://127.0.0.1:{ports.client}"


@asynccontextmanager
async def linked(arm_timeout_s: float = 15.0) -> AsyncIterator[tuple[Px4, Simulator]]:
    """Connect the adapter to a mock that stands off the origin and faces left."""
    simulator, url = standing_off_the_origin()
    px4 = Px4Config(url=url, answer_timeout_s=2.0, arm_timeout_s=arm_timeout_s)
    async with simulator as mock, open_px4(px4, MonotonicClock()) as autopilot:
        yield autopilot, mock


async def see(autopilot: Px4, position_w_m: tuple[float, float, float], yaw_rad: float, for_s: float) -> None:
    """Forward one pose at 50 Hz."""
    for _ in range(round(for_s * 50)):
        autopilot.send_vision(np.array(position_w_m), quat_from_yaw(yaw_rad))
        await asyncio.sleep(0.02)


async def until_armable(autopilot: Px4) -> None:
    """Send vision and a setpoint, and start OFFBOARD mode, so that the autopilot can be armed."""
    await see(autopilot, (0.8, 0.5, 0.0), 1.0, 1.0)
    autopilot.send_setpoint(idle_setpoint(1.0))
    await asyncio.sleep(0.1)
    await autopilot.start_offboard()
