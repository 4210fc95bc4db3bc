"""The PX4 adapter over MAVSDK and UDP against the mock: frames, refusals, and an autopilot that falls silent."""

import asyncio
import math
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from companion.adapters.clock import MonotonicClock
from companion.adapters.px4 import Px4, open_px4
from companion.cli.mock_process import free_ports
from companion.config import Px4Config
from companion.control.frames import quat_from_yaw, yaw_of
from companion.control_stage import idle_setpoint
from companion.ports import AutopilotError
from companion.types import AttitudeThrust, FlightMode
from mock_autopilot.config import MockConfig
from mock_autopilot.simulator import Simulator

pytestmark = pytest.mark.realtime

ROOT = Path(__file__).resolve().parents[2]
START_NED_M = (0.8, -0.5, 0.0)
START_YAW_NED_RAD = -1.0


def standing_off_the_origin() -> tuple[Simulator, str]:
    """A mock without cameras and arms, and where to hear it."""
    ports = free_ports()
    config = MockConfig.load(ROOT / "config" / "mock.toml").model_dump()
    config["mavlink"] |= {"local_port": ports.autopilot, "remote_port": ports.client}
    config["vehicle"] |= {"start_position_ned_m": START_NED_M, "start_yaw_rad": START_YAW_NED_RAD}
    config["arms"]["enabled"] = False
    return Simulator(MockConfig.from_dict(config), 1, with_qualisys=False), f"udpin://127.0.0.1:{ports.client}"


@asynccontextmanager
async def linked(arm_timeout_s: float = 15.0) -> AsyncIterator[tuple[Px4, Simulator]]:
    """The adapter and a mock that stands off the origin and looks to the left."""
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
    """Vision flows, setpoints stream, OFFBOARD is shown."""
    await see(autopilot, (0.8, 0.5, 0.0), 1.0, 1.0)
    autopilot.send_setpoint(idle_setpoint(1.0))
    await asyncio.sleep(0.1)
    await autopilot.start_offboard()


async def test_a_pose_in_w_arrives_in_the_autopilots_frame() -> None:
    async with linked() as (autopilot, mock):
        await see(autopilot, (0.8, 0.5, 0.0), 1.0, 2.0)
        start = np.array(START_NED_M)
        believed = np.array(mock.world.vehicle.estimate.position_m)
        assert believed == pytest.approx(start, abs=0.05), "x to north, y to the west, up is up"
        assert float(yaw_of(autopilot.status().q_w_flu_wxyz)) == pytest.approx(1.0, abs=0.05), "left is positive in W"


async def test_offboard_and_armed_count_when_the_heartbeat_shows_them() -> None:
    async with linked() as (autopilot, mock):
        await until_armable(autopilot)
        assert autopilot.status().mode is FlightMode.OFFBOARD
        await autopilot.arm()
        assert autopilot.status().armed
        assert mock.world.vehicle.armed
        await autopilot.disarm()
        assert not autopilot.status().armed


async def test_a_refusal_is_told_in_the_autopilots_own_words() -> None:
    async with linked(arm_timeout_s=0.0001) as (autopilot, _):
        await asyncio.sleep(2.0)  # texts are held back for 1.5 s after boot, and until a ground station is heard
        with pytest.raises(AutopilotError, match="refused to arm: Arming denied"):
            await autopilot.arm()  # in Hold and without a position


async def test_a_setpoint_leaning_forward_brings_the_nose_down_at_the_autopilot() -> None:
    async with linked() as (autopilot, mock):
        await until_armable(autopilot)
        half = math.radians(5.0)
        forward = np.array([math.cos(half), 0.0, math.sin(half), 0.0])  # FLU: a turn about left, nose down
        autopilot.send_setpoint(AttitudeThrust(forward, np.array(0.3)))
        await asyncio.sleep(0.2)
        w, x, y, z = mock.world.vehicle.followed.q_wxyz
        pitch_deg = math.degrees(math.asin(2.0 * (w * y - z * x)))
        assert pitch_deg == pytest.approx(-10.0, abs=0.01)


async def test_an_autopilot_that_falls_silent_ends_every_wait() -> None:
    mock, url = standing_off_the_origin()
    px4 = Px4Config(url=url, answer_timeout_s=1.0, arm_timeout_s=1.0)
    await mock.__aenter__()
    async with open_px4(px4, MonotonicClock()) as autopilot:
        await mock.__aexit__()  # the cable is pulled
        autopilot.send_setpoint(idle_setpoint(0.0))
        begun_s = time.monotonic()
        for command in (autopilot.start_offboard, autopilot.arm, autopilot.land):
            with pytest.raises(AutopilotError):
                await command()
        assert time.monotonic() - begun_s < 30.0
