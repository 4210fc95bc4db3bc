"""Simulated servos on a pseudo-terminal, and `companion arms` as a process of its own at the other end."""

import asyncio
import tomllib
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.config_arms import ArmsConfig
from companion.types import Array
from mock_autopilot.dynamixel_alone import BusAlone
from mock_autopilot.dynamixel_config import DynamixelConfig, Fault, FaultKind
from mock_autopilot.servo import Servo
from tests.flights.command import ROOT, Ran, Running, run, start

PATIENCE_S = 60.0
ARMS = ArmsConfig()
_ZERO_RAD = np.array([ARMS.servos[name].zero_rad for name in ARMS.servos])


@dataclass(frozen=True)
class ArmsRig:
    """Both arms, stowed and limp at first."""

    alone: BusAlone
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
    def speeds_radps(self) -> Array:
        """How fast the joints really turn, (8,)."""
        return np.abs(self.alone.bus.servos.velocities_radps)

    @property
    def powered(self) -> list[bool]:
        """Which servos really have torque."""
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
    async with BusAlone(DynamixelConfig.model_validate({"servos": servos})) as alone:
        config = folder / "bench.toml"
        config.write_text(f'[arms]\nport = "{alone.path}"\n', encoding="utf-8")
        yield ArmsRig(alone, config)
