"""Parts that all `companion arms` commands share: the configuration, the bus, exit codes."""

import asyncio
import logging
from collections.abc import AsyncIterator, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import typer

from companion.adapters.dynamixel.bus import DynamixelBus, open_dynamixel
from companion.adapters.system.clock import MonotonicClock
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.cli.options import vehicle_settings
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.config.locations import vehicle_config_path
from companion.core.interfaces import ArmError, ConfigError

CLOCK = MonotonicClock()
T = TypeVar("T")

_WITHOUT_A_VEHICLE = (
    "or try it without a vehicle: start `python -m mock_autopilot --config config/mock.toml` in another terminal and "
    "add `--config config/demo.toml` here"
)


@dataclass(frozen=True)
class Bench:
    """The vehicle on the bench."""

    config: CompanionConfig
    arms: ArmsConfig

    def floor(self, given_z_m: float | None) -> float | None:
        """Return the floor's height in the body frame, m: the given one, else the configured `stands_at_m`."""
        return self.arms.floor_z_m if given_z_m is None else given_z_m


def bench_of(config: Path | None, port: str | None) -> Bench:
    """Return the bench that the options describe; ConfigError when the file is unusable or has no arms."""
    logging.basicConfig(level=logging.CRITICAL)  # the commands print the driver's errors themselves
    settings = vehicle_settings(config)
    if settings.arms is None:
        raise ConfigError(
            f"{config or vehicle_config_path()}: has no table [arms], so this vehicle has no arms: add the table, with "
            "the `port` of their servos, or give another file by --config"
        )
    arms = settings.arms if port is None else settings.arms.model_copy(update={"port": port})
    return Bench(settings, arms)


@asynccontextmanager
async def open_bus(arms: ArmsConfig, strict: bool = True) -> AsyncIterator[DynamixelBus]:
    """Open the servos' bus alone, see `open_dynamixel`; ArmError with the remedy on the bench."""
    async with AsyncExitStack() as stack:
        try:
            bus = await stack.enter_async_context(open_dynamixel(arms, CLOCK, strict))
        except ArmError as error:
            raise ArmError(f"{error}{_advice(arms, str(error))}") from error
        yield bus


def _advice(arms: ArmsConfig, said: str) -> str:
    if not Path(arms.port).exists():
        return f"; {_WITHOUT_A_VEHICLE}"
    if "in use by another process" in said:
        return "; if it is `companion serve`, command its arms by `companion arms live`"
    return "\n  `companion arms clear` forgets what is latched from before" if "latched from before" in said else ""


async def cycles(bus: DynamixelBus, count: int, timeout_s: float = 1.0) -> None:
    """Wait until the bus has completed `count` more cycles, or until `timeout_s` is over."""
    goal, end_s = bus.status().cycles + count, CLOCK.now_s() + timeout_s
    while bus.status().cycles < goal and CLOCK.now_s() < end_s:  # noqa: ASYNC110  # the bus's thread has no event
        await asyncio.sleep(0.005)


def run(work: Coroutine[None, None, T], interrupted: str = "interrupted") -> T:
    """Run `work`; a Ctrl-C that it does not handle ends with the sentence `interrupted` and exit code 130."""
    try:
        return asyncio.run(work)
    except KeyboardInterrupt:
        typer.echo(interrupted, err=True)
        raise typer.Exit(INTERRUPTED) from None


def failed(error: ArmError) -> typer.Exit:
    """Print an error of a command that had begun; return the exception to raise."""
    typer.echo(f"companion: {error}", err=True)
    return typer.Exit(FAILED)
