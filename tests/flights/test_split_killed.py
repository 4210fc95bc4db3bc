"""Ground law and vehicle's service, killed or stopped in the air: PX4 lands, and nobody flies the vehicle after that.

Real processes on real sockets; one mock for all.
"""

import signal
import time
from pathlib import Path

import pytest

from companion.core.types import FlightMode
from tests.flights.served import NO_ARMS, Served, Site, looking_on, mocks, serving
from tests.flights.test_dead_man import modes_after, until
from tests.flights.test_serving import flying
from tests.mavlink_relay import Relay

pytestmark = pytest.mark.realtime

HEIGHT_M = 0.4
BRIEFLY = ("SYS_HAS_GPS = 0", "SYS_HAS_GPS = 0\nCOM_DISARM_LAND = 0.2")
"""PX4 disarms soon after a landing."""


async def test_what_is_killed_or_stopped_in_the_air_leaves_the_landing_to_the_autopilot(tmp_path: Path) -> None:
    with Relay() as relay:
        site = Site.embedded(tmp_path, relay.ports)
        config = site.config(arms=False, url=relay.url, law_on_ground=True)
        async with mocks(site, NO_ARMS, BRIEFLY), serving(config, tmp_path / "vehicle.log") as vehicle:
            await vehicle.says("the vehicle is there")
            for number in (signal.SIGKILL, signal.SIGSTOP):
                async with serving(config, tmp_path / f"ground-{number}.log", "law") as ground:
                    await ground.says("has taken the law")
                    await the_ground_law_ends(site, vehicle, ground, number, relay)
            async with serving(config, tmp_path / "ground.log", "law") as ground:
                await ground.says("has taken the law")
                await the_stopped_service_ends(site, vehicle, relay)
                async with serving(config, tmp_path / "again.log") as again:
                    await again.says("the vehicle is there")
                    await ground.until(lambda: ground.log.count("has taken the law") == 2)


async def the_ground_law_ends(site: Site, vehicle: Served, ground: Served, number: int, relay: Relay) -> None:
    """In the air, by a signal; PX4 lands, and after SIGCONT the ground law is not followed either."""
    async with looking_on(site.place, vehicle) as seen:
        await seen.phase("standby", "disarmed")
        await flying(site, HEIGHT_M)
        since_s = time.monotonic()
        ground.process.send_signal(number)
        landing = await seen.phase("handed over")
        assert "ground law" in landing.reason, landing
        ground.process.send_signal(signal.SIGCONT) if number == signal.SIGSTOP else None
        await seen.phase("disarmed")
        await px4_has_landed(relay, since_s)


async def the_stopped_service_ends(site: Site, vehicle: Served, relay: Relay) -> None:
    """In the air it is stopped, for which the kernel kills it; PX4's failsafe lands, whatever the ground law sends."""
    async with looking_on(site.place, vehicle) as seen:
        await seen.phase("standby", "disarmed")
        await flying(site, HEIGHT_M)
    since_s = time.monotonic()
    vehicle.process.send_signal(signal.SIGSTOP)
    assert await vehicle.ended() == -signal.SIGKILL
    await px4_has_landed(relay, since_s)


async def px4_has_landed(relay: Relay, since_s: float) -> None:
    """Wait until it is disarmed; from the beginning of PX4's landing on nobody has flown it."""
    await until(lambda: bool(modes := modes_after(relay, since_s)) and not modes[-1][1])
    modes = modes_after(relay, since_s)
    assert (FlightMode.LAND, True) in modes
    assert (FlightMode.OFFBOARD, True) not in modes[modes.index((FlightMode.LAND, True)) :]
