"""Cost of record and telemetry for the tick: a flight in which they are switched on in turns."""

import asyncio
import json
from dataclasses import dataclass

from benchmarks.figures import Spread, spread
from benchmarks.flights import FlightPlan, Progress, end, hovering, mock_config, task_of
from benchmarks.onlooked import ALL, NOBODY, RECORD
from benchmarks.peer import Stamps, simulated_room
from benchmarks.subject import Task
from companion.cli.demo.mock_process import free_ports
from companion.config.companion_config import CompanionConfig


@dataclass(frozen=True)
class OnlookersCost:
    """Whole ticks of one flight, by who looked on, microseconds."""

    rate_hz: float
    alone_us: Spread
    record_us: Spread
    all_us: Spread
    """Record and telemetry."""

    @property
    def record_share(self) -> float:
        """The time that the record adds to the median tick, as a share of it."""
        return self.record_us.median / self.alone_us.median - 1.0

    @property
    def all_share(self) -> float:
        """The time that record and telemetry add to the median tick."""
        return self.all_us.median / self.alone_us.median - 1.0


async def measure_onlookers(rate_hz: float, for_s: float, say: Progress) -> OnlookersCost:
    """Hover under a law that sends in every cycle."""
    plan, ports = FlightPlan(rate_hz, True, False, for_s), free_ports()
    async with simulated_room(mock_config(plan, ports), Stamps(), None):
        say("taking off")
        async with hovering("benchmarks.onlooked", patient(task_of(plan, ports))) as process:
            say(f"hovering for {for_s:g} s")
            await asyncio.sleep(for_s)
            took_s = json.loads(await end(process))
    return OnlookersCost(rate_hz, *(spread([1e6 * value for value in took_s[name]]) for name in (NOBODY, RECORD, ALL)))


def patient(task: Task) -> Task:
    """Only the length of a tick counts: a busy computer, whose frames come late, need not end the flight."""
    data = task.config.model_dump()
    data["safety"] |= {"silent_s": 0.5, "delayed_s": 0.3, "autopilot_silent_s": 2.0}
    return task.model_copy(update={"config": CompanionConfig.model_validate(data)})
