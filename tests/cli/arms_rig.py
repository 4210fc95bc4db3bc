"""Simulated servos on a pseudo-terminal, and `companion arms` as a process of its own at the other end."""

import asyncio
import os
import signal
import sys
import tomllib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.config.arms_config import ArmsConfig
from companion.core.types import Array
from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind
from mock_autopilot.servos.servo import Servo
from tests import warm
from tests.flights.command import ROOT, Ran, Running, run, start
from tests.mock_autopilot.servos.standalone_bus import StandaloneBus

PATIENCE_S = 60.0
_STILL_RADPS = 0.05
ARMS = ArmsConfig()
_ZERO_RAD = np.array([ARMS.servos[name].zero_rad for name in ARMS.servos])


@dataclass(frozen=True)
class ArmsRig:
    """Both arms, stowed and limp at first."""

    alone: StandaloneBus
    config: Path
    """For `--config`."""

    async def run(self, *arguments: str) -> Ran:
        """Run `companion arms ARGUMENTS` to its end."""
        return await run("arms", *arguments, "--config", self.config)

    async def start(self, *arguments: str) -> Running:
        """Start it."""
        return await start("arms", *arguments, "--config", self.config)

    @property
    def joints_rad(self) -> Array:
        """True joint angles, (8,)."""
        return np.asarray(self.alone.bus.servos.positions_rad - _ZERO_RAD)

    @property
    def stands_still(self) -> bool:
        """Return True if no joint really turns."""
        return bool((np.abs(self.alone.bus.servos.motion()[1]) < _STILL_RADPS).all())

    @property
    def powered(self) -> list[bool]:
        """Return for each servo whether it really has torque."""
        return [servo.motor.powered for servo in self.alone.bus.servos.servos]

    def servo(self, servo_id: int) -> Servo:
        """For looking into it."""
        return self.alone.bus.servos.servo(servo_id)

    def fault(self, kind: FaultKind, servo_id: int | None = None) -> None:
        """Begin a fault now."""
        self.alone.bus.inject(Fault(kind=kind, id=servo_id))

    async def moved(self, joint: int, by_rad: float = 0.2) -> None:
        """Wait until a joint has left where it is now by so much."""
        begin_rad = self.joints_rad[joint]
        await until(lambda: abs(self.joints_rad[joint] - begin_rad) > by_rad)


async def until(holds: Callable[[], object]) -> None:
    """Wait for something that has to come; fails when it does not."""
    async with asyncio.timeout(PATIENCE_S):
        while not holds():  # noqa: ASYNC110  # nobody signals: it is a state that is looked at
            await asyncio.sleep(0.005)


@asynccontextmanager
async def arms_rig(folder: Path, **changes: dict[str, Any]) -> AsyncIterator[ArmsRig]:
    """The servos of config/mock.toml, some of them changed: `arms_rig(folder, id2={"firmware": 30})`."""
    with (ROOT / "config" / "mock.toml").open("rb") as file:
        bus = tomllib.load(file)["arms"]["bus"]
    servos = [servo | changes.get(f"id{servo['id']}", {}) for servo in bus["servos"]]
    async with StandaloneBus(DynamixelConfig.model_validate({"servos": servos})) as alone:
        config = folder / "bench.toml"
        config.write_text(f'[arms]\nport = "{alone.path}"\n', encoding="utf-8")
        yield ArmsRig(alone, config)


class OnTerminal:
    """`companion arms` on a terminal of its own."""

    def __init__(self, process: asyncio.subprocess.Process, master: int) -> None:
        self._process, self._master = process, master
        self._seen = b""
        asyncio.get_running_loop().add_reader(master, self._take)

    @property
    def seen(self) -> str:
        """Everything that was on the screen."""
        return self._seen.decode(errors="replace")

    def _take(self) -> None:
        try:
            self._seen += os.read(self._master, 65536)
        except OSError:  # the other end is closed
            asyncio.get_running_loop().remove_reader(self._master)

    async def until(self, text: str) -> None:
        """Wait until this was on the screen."""
        await until(lambda: text in self.seen)

    def type_in(self, text: str) -> None:
        """Press these keys."""
        os.write(self._master, text.encode())

    def interrupt(self) -> None:
        """Ctrl-C."""
        self._process.send_signal(signal.SIGINT)

    async def ended(self) -> int:
        """Its exit code, once it has ended."""
        async with asyncio.timeout(PATIENCE_S):
            code = await self._process.wait()
        self._take()
        return code

    def close(self) -> None:
        """Take the terminal away."""
        asyncio.get_running_loop().remove_reader(self._master)
        os.close(self._master)
        if self._process.returncode is None:
            self._process.kill()


@asynccontextmanager
async def on_terminal(rig: ArmsRig, *arguments: str) -> AsyncIterator[OnTerminal]:
    """Run `companion arms ARGUMENTS` where a person sits."""
    master, slave = os.openpty()
    process = await warm.create_process(
        *(sys.executable, "-m", "companion.cli.main", "arms", *arguments, "--config", str(rig.config)),
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "200", "TERM": "xterm-256color"},
        stdin=slave,
        stdout=slave,
        stderr=slave,
    )
    os.close(slave)
    terminal = OnTerminal(process, master)
    try:
        yield terminal
    finally:
        terminal.close()
