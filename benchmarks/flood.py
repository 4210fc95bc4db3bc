"""Cost of many open pages for the tick: a flight in which hundreds of them are open in turns."""

import asyncio
import json
from bisect import bisect_right
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from itertools import pairwise
from queue import SimpleQueue

from benchmarks.figures import Spread, spread
from benchmarks.flights import FlightPlan, Progress, end, first_line, hovering, mock_config, python_process, task_of
from benchmarks.machine import realtime_priority
from benchmarks.onlookers import patient
from benchmarks.peer import Stamps, simulated_room
from companion.cli.demo.mock_process import free_ports, free_tcp_port
from companion.config.operator_config import OperatorConfig, PageConfig
from companion.service.page_process import PageOptions, page_process

ALONE, FLOODED = "alone", "flooded"
_SETTLE_S = 0.5
_MOCKS_PRIORITY = 40
"""Below that of the service: a real QTM and a real PX4 are other machines."""
_CLOSE = 0.5
"""Part of a period."""
_PATIENCE_S = 20.0


@dataclass(frozen=True)
class Heard:
    """States that each page has heard in one turn, and the number of pages that the server has closed."""

    states: list[int]
    lost: int
    for_s: float


@dataclass(frozen=True)
class Turn:
    """One turn of the flight: durations of its ticks, and the frames that they used."""

    name: str
    took_s: list[float]
    used: list[tuple[int, float]]


@dataclass(frozen=True, kw_only=True)
class FloodCost:
    """Whole ticks of one flight with and without open pages, and what became of frames and pages."""

    rate_hz: float
    pages: int
    alone_us: Spread
    flooded_us: Spread
    frames: int
    """Frames that came while the pages were open."""
    dropped: int
    """Of these, frames that no tick used although the next one was not close behind."""
    dropped_alone: int
    """The same in this flight while no page was open."""
    states_per_s: float
    """States that the page with the fewest of them heard each second."""
    closed: int
    """Pages that the server gave up."""
    realtime: bool
    """The service had its priority (SCHED_FIFO); without it, it shares the cores with all else."""

    @property
    def share(self) -> float:
        """The time that the pages add to the median tick, as a share of it."""
        return self.flooded_us.median / self.alone_us.median - 1.0


async def measure_flood(rate_hz: float, pages: int, turns: Sequence[float], say: Progress) -> FloodCost:
    """Measure as below, with mocks that are on time on a busy computer, where that is allowed."""
    with realtime_priority(_MOCKS_PRIORITY):
        return await _measure(rate_hz, pages, turns, say)


async def _measure(rate_hz: float, pages: int, turns: Sequence[float], say: Progress) -> FloodCost:
    """Hover under a law that sends in every cycle; each of `turns` is a time (s) without pages, and one with them."""
    plan, ports = FlightPlan(rate_hz, True, False, sum(turns)), free_ports()
    broker = OperatorConfig(embedded=True, port=free_tcp_port())
    task = patient(task_of(plan, ports))
    task = task.model_copy(update={"config": task.config.model_copy(update={"operator": broker})})
    heard: list[Heard] = []
    stamps = Stamps()
    async with simulated_room(mock_config(plan, ports), stamps, None):
        say("taking off")
        async with hovering("benchmarks.flooded", task) as process, _clients(broker, pages) as clients:
            realtime = await first_line(process) == "true"
            for turn, for_s in enumerate(turns, 1):
                say(f"{pages} pages, turn {turn} of {len(turns)}")
                await _turn(process, ALONE, for_s)
                await _say(clients, "open")
                await first_line(clients)
                await _turn(process, FLOODED, for_s)
                await _say(clients, "close")
                heard.append(Heard(**json.loads(await first_line(clients))))
            turns_of = [Turn(name, took_s, used) for name, took_s, used in json.loads(await end(process))]
    alone, flooded = ([turn for turn in turns_of if turn.name == name] for name in (ALONE, FLOODED))
    dropped = [
        sum(dropped_of(turn.used, stamps.frames_s, _CLOSE / rate_hz) for turn in some) for some in (alone, flooded)
    ]
    return FloodCost(
        rate_hz=rate_hz,
        pages=pages,
        alone_us=spread([1e6 * value for turn in alone for value in turn.took_s]),
        flooded_us=spread([1e6 * value for turn in flooded for value in turn.took_s]),
        frames=sum(len(turn.used) for turn in flooded) + dropped[1],
        dropped=dropped[1],
        dropped_alone=dropped[0],
        states_per_s=min(min(said.states) / said.for_s for said in heard),
        closed=sum(said.lost for said in heard),
        realtime=realtime,
    )


def dropped_of(used: Sequence[tuple[int, float]], sent_s: Sequence[float], close_s: float) -> int:
    """Return how many frames no tick used, between the first and the last of `used` (number, arrival).

    A frame that the mocks sent less than `close_s` before the next one does not count: a busy computer makes them late,
    and of two that come together the newer one is to be used.
    """
    dropped = 0
    for (number, _), (after, received_s) in pairwise(used):
        newest = bisect_right(sent_s, received_s) - 1
        for missing in range(1, after - number):
            place = newest - missing
            dropped += place >= 0 and sent_s[place + 1] - sent_s[place] >= close_s
    return dropped


async def _turn(process: asyncio.subprocess.Process, name: str, for_s: float) -> None:
    """Let one turn begin and last; the time until the next begins is nobody's."""
    await asyncio.sleep(_SETTLE_S)
    await _say(process, name)
    await asyncio.sleep(for_s)
    await _say(process, "between")


async def _say(process: asyncio.subprocess.Process, word: str) -> None:
    assert process.stdin is not None
    process.stdin.write(f"{word}\n".encode())
    await process.stdin.drain()


@asynccontextmanager
async def _clients(broker: OperatorConfig, pages: int) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run the page's server and the process of its clients."""
    lines: SimpleQueue[str] = SimpleQueue()
    with page_process(PageOptions(broker, PageConfig(port=0), quiet=True), lines.put):
        line = await asyncio.to_thread(lines.get, timeout=_PATIENCE_S)
        host = line.removeprefix("page: http://").rstrip("/")
        async with python_process("benchmarks.page_clients", host, str(pages)) as process:
            yield process
