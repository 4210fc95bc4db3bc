"""The service as the process in which a flood of pages is measured: hovers, and times its own ticks.

Run as `python -m benchmarks.flooded JSON`; it takes the priority that systemd gives the service, if it may. Prints
"flying" once it hovers, and whether in real time. Each line of standard input names the turn
that begins; at its end it prints one line of JSON: for each turn the durations of its ticks (s), and the number and the
arrival (s, monotonic) of each frame that they used.
"""

import asyncio
import json
import os
import sys
import time
from collections.abc import Callable

import uvloop

from benchmarks.machine import realtime_priority
from benchmarks.subject import Task
from companion.adapters.system.watchdog_timer import KernelWatchdogTimer
from companion.flight.tick import Tick
from companion.service.local_operator import open_local_operator

_PRIORITY = 50
"""CPUSchedulingPriority in systemd/dauam-companion.service."""


class _Turns:
    """A TickSink, and a stop-watch: each turn's frames and durations of ticks."""

    def __init__(self) -> None:
        self.turns: list[tuple[str, list[float], list[tuple[int, float]]]] = []

    def begin(self, name: str) -> None:
        """Begin a turn."""
        self.turns.append((name, [], []))

    def __call__(self, tick: Tick) -> None:
        if self.turns and tick.frame is not None:
            self.turns[-1][2].append((tick.frame.frame, tick.frame.received_s))

    def timed(self, tick: Callable[[float, float], None]) -> Callable[[float, float], None]:
        """Return the loop's tick with a stop-watch."""

        def run(now_s: float, late_s: float) -> None:
            start_s = time.perf_counter()
            tick(now_s, late_s)
            if self.turns:
                self.turns[-1][1].append(time.perf_counter() - start_s)

        return run


async def _fly(task: Task) -> None:
    turns = _Turns()
    watchdog_timer = KernelWatchdogTimer(task.config.safety.dead_man_s)
    async with open_local_operator(task.config, task.law(), turns, watchdog_timer) as operator:
        loop = operator.service.loop
        setattr(loop, "tick", turns.timed(loop.tick))  # noqa: B010 - it is a method for mypy
        await operator.do("arm")
        await operator.do("takeoff")
        print("flying", flush=True)
        print(json.dumps(os.sched_getscheduler(0) == os.SCHED_FIFO), flush=True)
        while name := (await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)).strip():
            turns.begin(name)
        said = json.dumps(turns.turns)
    print(said, flush=True)


if __name__ == "__main__":
    with realtime_priority(_PRIORITY):
        uvloop.run(_fly(Task.model_validate_json(sys.argv[1])))
