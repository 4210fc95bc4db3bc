"""The computer that flies, and its broker: disk, clock, priority, other vehicles' services."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.core.types import OtherService
from companion.preflight.checks.check import Check

_RECORD_MB = 100.0
"""Space for the records of a day beyond the limit that ends one."""
_RESOLUTION_S = 1e-4
_NICE = -10


@dataclass(frozen=True)
class ComputerFacts:
    """State of this computer and this process."""

    disk_free_mb: float
    """Free space for records (MB); infinite when nothing is recorded to disk."""
    clock_resolution_s: float
    """Resolution of the monotonic clock."""
    clock_sane: bool
    """The system clock is not before the time at which this software was installed."""
    clock_synchronised: bool | None
    """The kernel's word; None when it does not say."""
    realtime_priority: int
    """Priority under SCHED_FIFO or SCHED_RR; 0 for a process without."""
    nice: int


def check_disk(seen: ComputerFacts, limit_mb: float) -> Check:
    """Check that the disk has room for the flight's record; below `limit_mb` a flight is ended."""
    wanted_mb = limit_mb + _RECORD_MB
    free = "nothing is recorded" if math.isinf(seen.disk_free_mb) else f"{seen.disk_free_mb:.0f} MB free"
    says = f"{free}, at least {wanted_mb:.0f} wanted"
    return Check("disk space", seen.disk_free_mb >= wanted_mb, says, "delete or move old records")


def check_clock(seen: ComputerFacts) -> tuple[Check, Check]:
    """Check both clocks: timing uses the monotonic one, the system clock only names records."""
    ticks = f"monotonic to {1e6 * seen.clock_resolution_s:g} us"
    good = seen.clock_resolution_s <= _RESOLUTION_S and seen.clock_sane
    says = ticks if seen.clock_sane else f"{ticks}; the system clock is before this software was installed"
    synchronised = {True: "synchronised", False: "not synchronised", None: "the kernel does not say"}
    return (
        Check("clock", good, says, "set the system clock; a kernel without high-resolution timers cannot fly"),
        Check(
            "clock synchronised",
            seen.clock_synchronised is not False,
            synchronised[seen.clock_synchronised],
            "let chrony or systemd-timesyncd reach a server, or records carry a wrong time",
            must=False,
        ),
    )


def check_broker(age_s: float, where: str) -> Check:
    """Check that the operator's broker answers, `age_s` after its last answer."""
    says = f"{where} has not answered for {age_s:.1f} s" if age_s > 0.0 else f"{where} answers"
    todo = "start the broker, or look at operator.host, port, user and password, and at what that user may read"
    return Check("operator's broker", age_s <= 0.0, says, todo)


def check_priority(seen: ComputerFacts, must: bool) -> Check:
    """Check that the control loop has real-time priority over other programs."""
    realtime = seen.realtime_priority > 0
    says = f"real-time, {seen.realtime_priority}" if realtime else f"not real-time, nice {seen.nice}"
    todo = (
        "start the service with a real-time priority (systemd: CPUSchedulingPolicy=fifo, CPUSchedulingPriority=50; by "
        "hand: `sudo chrt -f 50`)"
    )
    if must:
        todo += "; where none can be had, [preflight] realtime = false makes this a warning"
    return Check("real-time priority", realtime or seen.nice <= _NICE, says, todo, must)


def check_others(others: Sequence[OtherService], order: Sequence[str]) -> tuple[Check, ...]:
    """Check that every other vehicle on the broker is one that this one stays away from.

    A vehicle that is not in `separation.order` is refused; without separation all of them are a warning, and no other
    vehicle is no line.
    """
    checked = _check_others(others, order)
    return () if checked is None else (checked,)


def _check_others(others: Sequence[OtherService], order: Sequence[str]) -> Check | None:
    name = "other vehicles"
    if not others:
        return Check(name, True, "none is on the broker") if order else None
    if not order:
        says = f"on the broker: {_vehicles(others)}; no separation is configured, so nothing keeps them apart"
        todo = "give [separation] order in every vehicle's file, unless they fly in another room"
        return Check(name, False, says, todo, must=False)
    strangers = [one for one in others if one.body not in order]
    if strangers:
        says = f"on the broker, and not in separation.order: {_vehicles(strangers)}"
        todo = "add its body to separation.order in every vehicle's file, or stop its service"
        return Check(name, False, says, todo)
    return Check(name, True, f"on the broker: {_vehicles(others)}; separation knows them")


def _vehicles(others: Sequence[OtherService]) -> str:
    return ", ".join(f"{one.vehicle} (body {one.body or 'not told'})" for one in others)
