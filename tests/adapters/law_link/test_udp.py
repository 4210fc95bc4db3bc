"""Both ends of the law's link over real sockets on this computer."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from companion.adapters.law_link.udp import GroundLink, VehicleLink, open_ground_link, open_law_link
from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.law_link.messages import Command
from tests.law_link.local import cycling, reporting, split_config, until

NOW_S = MonotonicClock().now_s


@pytest.fixture
def config(tmp_path: Path) -> CompanionConfig:
    return split_config(tmp_path)


def connected(vehicle: VehicleLink) -> Callable[[], bool]:
    return lambda: vehicle.end.status(NOW_S()).connected


@asynccontextmanager
async def joined(config: CompanionConfig) -> AsyncIterator[tuple[VehicleLink, GroundLink]]:
    clock = MonotonicClock()
    async with (
        open_law_link(config, clock) as vehicle,
        open_ground_link(config, "pid", clock) as ground,
        cycling(ground.send_due, reporting(vehicle)),
    ):
        await until(connected(vehicle))
        yield vehicle, ground


async def test_a_command_arrives_and_is_acknowledged(config: CompanionConfig) -> None:
    async with joined(config) as (vehicle, ground):
        await until(lambda: ground.end.report is not None)
        command = Command(accel_w_mps2=(0.5, -0.25, 0.125), yaw_rad=1.5, capture_ago=70)
        ground.end.command(command)
        await until(lambda: ground.end.report is not None and ground.end.report.number == 1)
        held = vehicle.end.use(NOW_S())
        assert held is not None
        assert held.command == command


async def test_both_clocks_are_compared_over_the_sockets(config: CompanionConfig) -> None:
    """They are one clock here, so the offset is nothing but the network's asymmetry."""
    async with joined(config) as (vehicle, ground):
        await until(lambda: vehicle.end.status(NOW_S()).round_trip_s > 0.0)
        trip_s = ground.end.clock.round_trip_s
        assert trip_s > 0.0
        assert abs(ground.end.clock.offset_s) <= 0.5 * trip_s + 1e-4


async def test_strangers_datagrams_are_dropped_and_named(config: CompanionConfig) -> None:
    async with joined(config) as (vehicle, _):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.bind(("127.0.0.1", 0))
            place = f"127.0.0.1:{stranger.getsockname()[1]}"
            for size in (0, 1, 8, 9, 24, 1400, 9000):
                stranger.sendto(b"\x05" * size, ("127.0.0.1", config.law.link.port))
            await until(lambda: vehicle.end.status(NOW_S()).foreign == 7)
            stranger.setblocking(False)
            with pytest.raises(BlockingIOError):
                stranger.recv(2048)  # nobody answers a stranger
        assert vehicle.end.status(NOW_S()).foreign_from == place
        assert vehicle.end.use(NOW_S()) is None


async def test_the_vehicle_answers_to_where_the_newest_message_came_from(config: CompanionConfig) -> None:
    """A workstation that changes its network card goes on in its session."""
    clock = MonotonicClock()
    async with open_law_link(config, clock) as vehicle, open_ground_link(config, "pid", clock) as ground:
        async with cycling(ground.send_due, reporting(vehicle)):
            await until(connected(vehicle))
        session = ground.end.session
        async with open_ground_link(config, "pid", clock) as elsewhere:
            elsewhere.end = ground.end
            reports = ground.end.counts.reports
            async with cycling(elsewhere.send_due, reporting(vehicle)):
                await until(lambda: ground.end.counts.reports > reports + 3)
        assert ground.end.session == session


async def test_a_vehicle_that_is_not_there_is_no_error_and_found_when_it_comes(config: CompanionConfig) -> None:
    clock = MonotonicClock()
    async with open_ground_link(config, "pid", clock) as ground, cycling(ground.send_due):
        await asyncio.sleep(0.1)
        assert ground.end.session is None
        async with open_law_link(config, clock) as vehicle:
            await until(connected(vehicle))
