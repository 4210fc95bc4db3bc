"""Both sides of the link on this computer: a configuration with its key, and a vehicle that stands."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from companion.adapters.law_link.udp import VehicleLink, open_law_link
from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import LawConfig, LawLinkConfig
from companion.config.mocap_config import MocapConfig
from tests.law_link.ends import shown
from tests.ports import free_port

CYCLE_S = 0.01
PATIENCE_S = 20.0
"""Far beyond what anything here takes."""


def key_file(folder: Path) -> Path:
    """Write a key that can be used."""
    key = folder / "law.key"
    key.write_text("0123456789abcdef\n", encoding="ascii")
    key.chmod(0o600)
    return key


def split_config(folder: Path) -> CompanionConfig:
    """Return a configuration for both sides, with free ports and no motion capture."""
    link = LawLinkConfig(port=free_port(), listen="127.0.0.1", key_file=str(key_file(folder)))
    return CompanionConfig(law=LawConfig(runs_on="ground", link=link), mocap=MocapConfig(port=free_port()))


@asynccontextmanager
async def cycling(*works: Callable[[], None]) -> AsyncIterator[None]:
    """Do this work in every cycle."""

    async def cycles() -> None:
        while True:
            for work in works:
                work()
            await asyncio.sleep(CYCLE_S)

    task = asyncio.create_task(cycles())
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def reporting(vehicle: VehicleLink, airborne: bool = True) -> Callable[[], None]:
    """Return the vehicle's part of a cycle: it reports the command that it holds."""
    now_s = MonotonicClock().now_s

    def report() -> None:
        held = vehicle.end.use(now_s())
        datagram = vehicle.end.report(shown(0 if held is None else held.number, airborne), now_s())
        if datagram is not None:
            vehicle.send(datagram)

    return report


@asynccontextmanager
async def standing_vehicle(config: CompanionConfig) -> AsyncIterator[VehicleLink]:
    """A vehicle that stands, and reports it."""
    async with open_law_link(config, MonotonicClock()) as link, cycling(reporting(link, airborne=False)):
        yield link


async def until(true: Callable[[], bool]) -> None:
    """Wait for something that has to come."""
    async with asyncio.timeout(PATIENCE_S):
        while True:
            if true():
                return
            await asyncio.sleep(CYCLE_S)
