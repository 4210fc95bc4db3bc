"""The service as the process in which onlookers are measured: hovers, and times its own ticks with and without them.

Run as `python -m benchmarks.onlooked JSON`. Prints "flying" once it hovers, and when standard input ends one line of
JSON: durations of ticks (s) by who looked on. Turns are short, so that all see the same seconds of the same machine.
"""

import asyncio
import json
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import cycle

import uvloop

from benchmarks.subject import Task
from companion.adapters.system.watchdog_timer import KernelWatchdogTimer
from companion.config.records_config import RecordsConfig
from companion.flight.tick import Tick, TickSink
from companion.records.record_process import RecordSink
from companion.service.local_operator import open_local_operator
from companion.service.telemetry import Telemetry

TURN_TICKS = 10
NOBODY, RECORD, ALL = "nobody", "record", "record and telemetry"


def main() -> None:
    """Fly the task of the first argument."""
    with tempfile.TemporaryDirectory() as folder:
        sink = RecordSink(RecordsConfig(folder=folder, live_port=0, min_free_mb=0.0), "bench")
        try:
            uvloop.run(_fly(Task.model_validate_json(sys.argv[1]), sink))
        finally:
            sink.close()


class _Turns:
    """A TickSink that hands each tick to one group of onlookers; and how long whole ticks took."""

    def __init__(self, groups: dict[str, list[TickSink]]) -> None:
        self._groups = groups
        self._turns = cycle(groups)
        self._now, self._left = next(self._turns), TURN_TICKS
        self.took_s: dict[str, list[float]] = {name: [] for name in groups}
        self.counts = False

    def __call__(self, tick: Tick) -> None:
        for sink in self._groups[self._now]:
            sink(tick)

    def timed(self, tick: Callable[[float, float], None]) -> Callable[[float, float], None]:
        """The loop's tick, with a stop-watch; the first of a turn, which finds other code in the caches, counts not."""

        def run(now_s: float, late_s: float) -> None:
            start_s = time.perf_counter()
            tick(now_s, late_s)
            if self.counts and self._left < TURN_TICKS:
                self.took_s[self._now].append(time.perf_counter() - start_s)
            self._left -= 1
            if self._left == 0:
                self._now, self._left = next(self._turns), TURN_TICKS

        return run


async def _fly(task: Task, record: RecordSink) -> None:
    telemetry = Telemetry("0" * 16, lambda _: None)
    turns = _Turns({NOBODY: [], RECORD: [record], ALL: [record, telemetry]})
    watchdog_timer = KernelWatchdogTimer(task.config.safety.dead_man_s)
    async with open_local_operator(task.config, task.law(), turns, watchdog_timer) as operator:
        loop = operator.service.loop
        setattr(loop, "tick", turns.timed(loop.tick))  # noqa: B010 - it is a method for mypy
        await operator.do("arm")
        await operator.do("takeoff")
        turns.counts = True
        print("flying", flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
        turns.counts = False
    print(json.dumps(turns.took_s), flush=True)


if __name__ == "__main__":
    main()
