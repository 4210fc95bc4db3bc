"""Requirements of the supervisor on the PX4 adapter: silence at once, early mode changes, and PX4's own estimate."""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import numpy as np
import pytest

from companion.adapters.px4.autopilot import Px4
from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.cli.demo.mock_process import free_ports
from companion.config.px4_config import Px4Config
from companion.control.pipeline import idle_setpoint
from companion.core.types import AttitudeThrust, FlightMode
from mock_autopilot.simulator import Simulator
from tests.adapters.px4.rig import linked, see, standing_off_the_origin, until_armable
from tests.beside import Beside
from tests.mavlink_relay import Relay

pytestmark = pytest.mark.realtime
beside = Beside(at_once=4)

PATIENCE_S = 10.0


@asynccontextmanager
async def relayed() -> AsyncIterator[tuple[Px4, Simulator, Relay]]:
    """Connect adapter and mock through a relay that records the messages."""
    with Relay() as relay:
        simulator, _ = standing_off_the_origin(relay.ports)
        async with simulator as mock, open_px4(Px4Config(url=relay.url), MonotonicClock()) as autopilot:
            yield autopilot, mock, relay


async def until(true: Callable[[], bool]) -> None:
    """Poll; a test that waits too long has failed."""
    async with asyncio.timeout(PATIENCE_S):
        while not true():  # noqa: ASYNC110 - the mock's world tells nobody
            await asyncio.sleep(0.005)


async def arrived_in(relay: Relay, for_s: float) -> int:
    """Count the setpoints that the relay sees from now on."""
    before = len(relay.setpoints_s())
    await asyncio.sleep(for_s)
    return len(relay.setpoints_s()) - before


@beside
async def test_a_stopped_stream_is_silent_commands_no_mode_and_can_begin_again() -> None:
    async with relayed() as (autopilot, _, relay):
        await until_armable(autopilot)
        assert await arrived_in(relay, 0.5) > 5, "MAVSDK repeats the last setpoint"
        commanded = modes_asked(relay)
        autopilot.stop_stream()
        await asyncio.sleep(0.05)  # what was already on its way
        assert await arrived_in(relay, 1.0) == 0
        assert modes_asked(relay) == commanded
        autopilot.send_setpoint(idle_setpoint(1.0))
        assert await arrived_in(relay, 0.5) > 5
        autopilot.stop_stream()
        relay.cut = True
        await asyncio.sleep(0.1)
        autopilot.send_setpoint(idle_setpoint(1.0))
        autopilot.stop_stream()
        await asyncio.sleep(0.05)
        assert await arrived_in(relay, 0.5) == 0


def modes_asked(relay: Relay) -> int:
    """Return the number of mode commands, DO_SET_MODE."""
    return sum(p.kind == "COMMAND_LONG" and p.message.command == 176 for p in relay.from_client)


@beside
async def test_a_change_of_mode_is_known_before_the_next_heartbeat() -> None:
    async with linked() as (autopilot, mock):
        assert autopilot.warnings == ()
        await see(autopilot, (0.8, 0.5, 0.0), 1.0, 0.5)
        before_s = autopilot.status().heartbeat_s
        await until(lambda: autopilot.status().heartbeat_s > before_s)
        before_s = autopilot.status().heartbeat_s
        mock.world.vehicle.land()
        await until(lambda: autopilot.status().mode is FlightMode.LAND)
        assert autopilot.status().heartbeat_s == before_s


@beside
async def test_an_autopilot_that_refuses_current_mode_is_told_of_and_heard_by_its_heartbeat() -> None:
    simulator, url = standing_off_the_origin()
    del simulator.links[0].streams._streams[436]
    del simulator.links[0].streams._due_s[436]
    async with simulator as mock, open_px4(Px4Config(url=url), MonotonicClock()) as autopilot:
        [warning] = autopilot.warnings
        assert "seen up to a second late" in warning
        mock.world.vehicle.land()
        await until(lambda: autopilot.status().mode is FlightMode.LAND)


@beside
async def test_the_autopilots_age_and_its_reboot_show() -> None:
    simulator, url = standing_off_the_origin(ports := free_ports())
    await simulator.__aenter__()
    async with open_px4(Px4Config(url=url), MonotonicClock()) as autopilot:
        await until(lambda: autopilot.status().boot_s > 2.0)
        assert autopilot.status().boot_s == pytest.approx(simulator.world.time_s, abs=0.5)
        await simulator.__aexit__()
        await asyncio.sleep(0.2)
        assert 0.0 <= autopilot.status().heard_s - autopilot.status().attitude_s < 0.1, "50 a second"
        silent_since_s = autopilot.status().heard_s
        await asyncio.sleep(0.3)
        assert autopilot.status().heard_s == silent_since_s <= time.monotonic() - 0.3
        rebooted, _ = standing_off_the_origin(ports)
        async with rebooted:
            await until(lambda: autopilot.status().boot_s < 2.0)
            assert autopilot.status().heard_s > silent_since_s
            await until(lambda: rebooted.links[0].streams.interval_us(436) == 50_000)


@beside
async def test_an_attitude_that_stays_away_is_no_fresh_one_although_heartbeats_come() -> None:
    async with linked() as (autopilot, mock):
        await until(lambda: math.isfinite(autopilot.status().attitude_s))
        del mock.links[0].streams._streams[31]
        del mock.links[0].streams._due_s[31]
        await asyncio.sleep(0.1)
        last_s, heartbeat_s = autopilot.status().attitude_s, autopilot.status().heartbeat_s
        await until(lambda: autopilot.status().heartbeat_s > heartbeat_s)
        assert autopilot.status().attitude_s == last_s < autopilot.status().heard_s


@beside
async def test_parameters_and_the_autopilots_own_position() -> None:
    async with linked() as (autopilot, _):
        assert not autopilot.local().vision_fused
        pose = asyncio.create_task(see(autopilot, (0.8, 0.5, 0.3), 1.0, 4.0))
        names = ("COM_OF_LOSS_T", "EKF2_EV_CTRL", "NO_SUCH_PARAM", "MPC_THR_HOVER")
        assert await autopilot.params(names) == {"COM_OF_LOSS_T": 0.5, "EKF2_EV_CTRL": 15.0, "MPC_THR_HOVER": 0.5}
        await until(lambda: autopilot.local().vision_fused)
        await pose
        local = autopilot.local()
        assert local.position_w_m == pytest.approx(np.array([0.8, 0.5, 0.3]), abs=0.05)
        assert local.velocity_w_mps == pytest.approx(np.zeros(3), abs=0.1)
        assert max(time.monotonic() - local.time_s, 0.0) < 1.0


@beside
async def test_kill_stops_the_motors_of_a_vehicle_that_refuses_to_disarm() -> None:
    async with linked() as (autopilot, mock):
        await until_armable(autopilot)
        await autopilot.arm()
        level = np.array([math.cos(0.5), 0.0, 0.0, math.sin(0.5)])
        autopilot.send_setpoint(AttitudeThrust(level, np.array(0.6)))
        await until(lambda: -mock.world.vehicle.sensor_state.motion.position_ned_m[2] > 0.3)
        disarming = asyncio.create_task(autopilot.disarm())
        await autopilot.kill()
        assert not mock.world.vehicle.armed
        assert not autopilot.status().armed
        await disarming  # it asks again and again, and now there is nothing to refuse
