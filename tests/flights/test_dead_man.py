"""A companion that hangs, or is stopped or killed, in the air: no setpoint leaves it, and PX4's offboard loss lands.

A relay between the processes says when the last setpoint arrived, by the kernel's clock.
"""

import asyncio
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from companion.adapters.px4.mavlink import flight_mode
from companion.core.types import FlightMode
from tests.flights.command import ROOT, mock_config
from tests.mavlink_relay import Relay
from tests.warm import mock_process

pytestmark = pytest.mark.realtime

SILENT_WITHIN_S = 0.25
PATIENCE_S = 40.0
ARMED_BIT = 128


class Companion:
    """tests/flights/hanging_service.py in a process of its own."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process

    def tell(self, line: str) -> None:
        """A line on its standard input."""
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n".encode())

    async def says(self, wanted: str) -> str:
        """Read its output until a line begins so; what follows in it."""
        assert self.process.stdout is not None
        heard: list[str] = []
        with suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE_S):
                while line := (await self.process.stdout.readline()).decode():
                    heard.append(line)
                    if line.startswith(wanted):
                        return line.removeprefix(wanted).strip()
        raise AssertionError(f"it did not say {wanted!r} but: {''.join(heard)}")


@dataclass
class Scene:
    """A companion that hovers, on the link of a mock."""

    relay: Relay
    flying: Companion


@asynccontextmanager
async def companion(relay: Relay) -> AsyncIterator[Companion]:
    """It imports and configures itself, and waits for a line."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "tests.flights.hanging_service",
        relay.url,
        str(relay.ports.qualisys),
        cwd=ROOT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    try:
        yield Companion(process)
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


@asynccontextmanager
async def hovering(folder: Path) -> AsyncIterator[Scene]:
    """In the air."""
    mock = mock_config(folder, ("enabled = true", "enabled = false"))
    with Relay() as relay:
        async with companion(relay) as flying, mock_process(mock, 1, relay.ports):
            flying.tell("open")
            await flying.says("hovering")
            yield Scene(relay, flying)


async def hang(scene: Scene, how: str) -> float:
    """Its event loop stops; when, by time.monotonic()."""
    scene.flying.tell(how)
    return float(await scene.flying.says("hangs at"))


async def until(true: Callable[[], bool]) -> None:
    """Poll what the relay writes down."""
    async with asyncio.timeout(PATIENCE_S):
        while not true():  # noqa: ASYNC110 - the relay tells nobody
            await asyncio.sleep(0.02)


def modes_after(relay: Relay, since_s: float) -> list[tuple[FlightMode, bool]]:
    """Mode and armed state in the autopilot's HEARTBEATs."""
    beats = [p.message for p in relay.from_autopilot if p.kind == "HEARTBEAT" and p.time_s > since_s]
    return [(flight_mode(beat.custom_mode), bool(beat.base_mode & ARMED_BIT)) for beat in beats]


def texts_after(relay: Relay, since_s: float) -> str:
    """All STATUSTEXTs."""
    return "\n".join(p.message.text for p in relay.from_autopilot if p.kind == "STATUSTEXT" and p.time_s > since_s)


async def assert_silent_and_px4_lands(scene: Scene, since_s: float) -> None:
    """The last setpoint at most 250 ms after the stop, then PX4's failsafe, which nobody disturbs."""
    await until(lambda: (FlightMode.LAND, True) in modes_after(scene.relay, since_s))
    assert "Failsafe activated" in texts_after(scene.relay, since_s)
    assert scene.relay.setpoints_s()[-1] - since_s <= SILENT_WITHIN_S


@pytest.mark.parametrize("how", ["block", "gil"])
async def test_a_loop_that_hangs_in_the_air_is_ended_and_px4_lands(how: str, tmp_path: Path) -> None:
    async with hovering(tmp_path) as scene:
        since_s = await hang(scene, how)
        await assert_silent_and_px4_lands(scene, since_s)
        assert scene.flying.process.returncode == -signal.SIGKILL


async def test_a_stopped_process_is_ended_and_does_not_come_back_when_continued(tmp_path: Path) -> None:
    async with hovering(tmp_path) as scene:
        since_s = time.monotonic()
        scene.flying.process.send_signal(signal.SIGSTOP)
        await asyncio.sleep(0.1)
        assert scene.flying.process.returncode is None
        await asyncio.sleep(0.4)
        with suppress(ProcessLookupError):
            scene.flying.process.send_signal(signal.SIGCONT)
        await assert_silent_and_px4_lands(scene, since_s)
        assert scene.flying.process.returncode == -signal.SIGKILL
