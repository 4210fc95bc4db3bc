"""The PX4 adapter over MAVSDK and UDP against the mock: frames, refusals, and an autopilot that falls silent."""

import asyncio
import math
import time

import numpy as np
import pytest

from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.config.px4_config import Px4Config
from companion.control.pipeline import idle_setpoint
from companion.core.interfaces import AutopilotError
from companion.core.types import AttitudeThrust, FlightMode
from companion.geometry.frames import yaw_of
from tests.adapters.px4.rig import START_NED_M, linked, see, standing_off_the_origin, until_armable
from tests.beside import Beside

pytestmark = pytest.mark.realtime
beside = Beside(at_once=4)


@beside
async def test_a_pose_in_w_arrives_in_the_autopilots_frame() -> None:
    async with linked() as (autopilot, mock):
        await see(autopilot, (0.8, 0.5, 0.0), 1.0, 2.0)
        start = np.array(START_NED_M)
        believed = np.array(mock.world.vehicle.estimate.position_m)
        assert believed == pytest.approx(start, abs=0.05), "x to north, y to the west, up is up"
        status = autopilot.status()
        assert float(yaw_of(status.q_w_flu_wxyz)) == pytest.approx(1.0, abs=0.05), "left is positive in W"
        assert status.velocity_w_mps == pytest.approx(np.zeros(3), abs=0.1)
        assert status.rate_flu_radps == pytest.approx(np.zeros(3), abs=0.1)
        assert min(status.velocity_s, status.attitude_s) > MonotonicClock().now_s() - 0.2, "both come again and again"


@beside
async def test_offboard_and_armed_count_when_the_heartbeat_shows_them() -> None:
    async with linked() as (autopilot, mock):
        await until_armable(autopilot)
        assert autopilot.status().mode is FlightMode.OFFBOARD
        await autopilot.arm()
        assert autopilot.status().armed
        assert mock.world.vehicle.armed
        await autopilot.disarm()
        assert not autopilot.status().armed


@beside
async def test_a_refusal_is_told_in_the_autopilots_own_words() -> None:
    async with linked(arm_timeout_s=0.0001) as (autopilot, _):
        await asyncio.sleep(2.0)  # texts are held back for 1.5 s after boot, and until a ground station is heard
        with pytest.raises(AutopilotError, match="refused to arm: Arming denied"):
            await autopilot.arm()  # in Hold and without a position


@beside
async def test_a_setpoint_leaning_forward_brings_the_nose_down_at_the_autopilot() -> None:
    async with linked() as (autopilot, mock):
        await until_armable(autopilot)
        half = math.radians(5.0)
        forward = np.array([math.cos(half), 0.0, math.sin(half), 0.0])  # FLU: a turn about left, nose down
        autopilot.send_setpoint(AttitudeThrust(forward, np.array(0.3)))
        await asyncio.sleep(0.2)
        w, x, y, z = mock.world.vehicle.attitude_setpoint.q_wxyz
        pitch_deg = math.degrees(math.asin(2.0 * (w * y - z * x)))
        assert pitch_deg == pytest.approx(-10.0, abs=0.01)


@beside
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
