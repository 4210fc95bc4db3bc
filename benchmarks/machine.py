"""Facts of the machine a benchmark ran on: enough to judge the numbers, nothing that names the machine."""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import psutil  # type: ignore[import-untyped]

PACKAGES = ("numpy", "mavsdk", "qtm-rt", "uvloop", "pymavlink", "pydantic")


@dataclass(frozen=True)
class Machine:
    """Machine and versions that the numbers depend on."""

    date: str
    cpu: str
    cores: int
    memory_gb: float
    kernel: str
    python: str
    packages: dict[str, str]
    load_at_start: tuple[float, float, float]
    """Runnable tasks, mean of 1, 5 and 15 minutes: what else the machine was doing."""


def this_machine() -> Machine:
    """Return the description of this computer and its software versions."""
    return Machine(
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        cpu=_cpu(),
        cores=os.cpu_count() or 0,
        memory_gb=round(psutil.virtual_memory().total / 2**30, 1),
        kernel=f"{platform.system()} {platform.release()} {platform.machine()}",
        python=f"{platform.python_implementation()} {platform.python_version()}",
        packages={name: version(name) for name in PACKAGES},
        load_at_start=os.getloadavg(),
    )


def _cpu() -> str:
    """Linux says it there; elsewhere Python's word has to do."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


@contextmanager
def realtime_priority(priority: int) -> Iterator[bool]:
    """Run the block, and the processes that it begins, before all normal ones (SCHED_FIFO); yield whether it may."""
    before, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, before, parameters)
