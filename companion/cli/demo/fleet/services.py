"""One `companion serve` process for each vehicle of a demo, which ends with the demo however that ends."""

import asyncio
import ctypes
import os
import signal
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from companion.client.roster import open_roster
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import CompanionError

_START_S = 60.0
_STOP_S = 70.0
"""Beyond the 60 s in which a service that is told to end lands."""
_LOOK_S = 0.1
_PR_SET_PDEATHSIG = 1
_LAST_LINES = 5


class ServiceError(CompanionError):
    """Failure of a vehicle's service, with its last words."""


@dataclass(frozen=True)
class Service:
    """Process of one vehicle's service, and its log."""

    name: str
    process: asyncio.subprocess.Process
    log: Path

    def require_running(self) -> None:
        """Raise ServiceError with its last lines when it has ended."""
        code = self.process.returncode
        if code is not None:
            lines = self.log.read_text(encoding="utf-8", errors="replace").splitlines()[-_LAST_LINES:]
            raise ServiceError(
                f"the service of {self.name} has ended ({code}): {' / '.join(lines) or 'without a word'}"
            )


@asynccontextmanager
async def open_services(configs: Sequence[Path], place: OperatorConfig) -> AsyncIterator[tuple[Service, ...]]:
    """Start a service for each file, named as its vehicle; yield when all are on the broker; at the end stop them."""
    async with AsyncExitStack() as stack:
        services = tuple([await stack.enter_async_context(_service(config)) for config in configs])
        await _all_there(services, place)
        yield services


@asynccontextmanager
async def _service(config: Path) -> AsyncIterator[Service]:
    log = config.with_suffix(".log")
    with log.open("wb") as journal:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "companion.cli.main", "serve", "--config", str(config)),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=journal,
            stderr=journal,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,  # Ctrl-C must reach only the demo, which lands first
            preexec_fn=_end_with_parent,
        )
    try:
        yield Service(config.stem, process, log)
    finally:
        await _stop(process)


def _end_with_parent() -> None:
    """Have the kernel send SIGTERM to this process when the demo dies, also by `kill -9`."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


async def _stop(process: asyncio.subprocess.Process) -> None:
    """Tell it to end, for which it lands, and wait; killed where it does not."""
    if process.returncode is None:
        process.terminate()
    try:
        async with asyncio.timeout(_STOP_S):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()


async def _all_there(services: Sequence[Service], place: OperatorConfig) -> None:
    wanted = {service.name for service in services}
    async with open_roster(place) as roster:
        try:
            async with asyncio.timeout(_START_S):
                while not wanted <= set(roster.names):
                    for service in services:
                        service.require_running()
                    await asyncio.sleep(_LOOK_S)
        except TimeoutError as error:
            missing = " and ".join(sorted(wanted - set(roster.names)))
            raise ServiceError(f"no service of {missing} on the broker within {_START_S:g} s") from error
