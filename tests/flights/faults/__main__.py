"""`make faults`: flies every row of the table and random schedules, says what became of each, writes docs/safety.md."""

import argparse
import logging
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from tests.flights.faults.drift import Drift
from tests.flights.faults.judge import Result
from tests.flights.faults.real import fly_real_named
from tests.flights.faults.report import FLOWN, RECOGNISED, flown, line_of, read_json, recognised, write_json, write_page
from tests.flights.faults.schedules import Outcome, fly_schedule
from tests.flights.faults.table import VIRTUAL
from tests.flights.faults.table_real import REAL
from tests.flights.faults.virtual import fly_named

SCHEDULES = 120
BEGUN_S = time.monotonic()
Item = TypeVar("Item", str, int)
Ended = TypeVar("Ended", Result, Outcome)


def main(arguments: list[str] | None = None) -> int:
    """Return 0 when every flight is as it must be."""
    options = _parser().parse_args(arguments)
    results = read_json(options.json) if options.resume else {}
    for result in _fly_rows(options, set(results)):
        results[result.name] = result
        if options.resume or not options.only:
            write_json(results, options.json)
    outcomes = [] if options.only else list(_fly("schedule", fly_schedule, range(options.random), os.cpu_count() or 1))
    rows = (*VIRTUAL, *REAL)
    if all(row.name in results for row in rows):
        write_page({RECOGNISED: recognised(), FLOWN: flown(rows, results)})
    return _summary(results, outcomes)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="make faults", description=__doc__)
    parser.add_argument("--only", default="", metavar="WORD", help="rows whose name contains it, no random schedules")
    parser.add_argument("--virtual", action="store_true", help="rows in simulated time only")
    parser.add_argument("--resume", action="store_true", help="keep the flights of the JSON file that were right")
    parser.add_argument("--random", type=int, default=SCHEDULES, metavar="N", help="number of random schedules")
    parser.add_argument("--json", type=Path, default=Path("faults.json"), help="results; --only needs --resume for it")
    return parser


def _fly_rows(options: argparse.Namespace, flown_before: set[str]) -> Iterator[Result]:
    """Yield the results of the chosen rows; those in real time are flown one by one, each in a fresh process."""

    def chosen(names: Iterator[str]) -> list[str]:
        return [name for name in names if options.only in name and name not in flown_before]

    yield from _fly("row", fly_named, chosen(row.name for row in VIRTUAL), os.cpu_count() or 1)
    if not options.virtual:
        yield from _fly("real-time row", fly_real_named, chosen(row.name for row in REAL), None)


def _fly(
    what: str,
    fly: Callable[[Item], Ended],
    items: Sequence[Item],
    processes: int | None,
) -> Iterator[Ended]:
    """Yield what became of each flight as it ends, and print a line of it; BrokenProcessPool when a process crashes.

    Without a number of processes one flight after the other, each in a new one. (Executors that replace a process after
    some tasks stop for ever in Python 3.11, https://github.com/python/cpython/issues/115634.)
    """
    flown = _fly_at_once(fly, items, processes) if processes else _fly_in_turn(fly, items)
    for number, ended in enumerate(flown, 1):
        print(f"{_minutes()} {what} {number}/{len(items)}: {line_of(ended)}", flush=True)
        yield ended


def _fly_at_once(fly: Callable[[Item], Ended], items: Sequence[Item], processes: int) -> Iterator[Ended]:
    with _executor(processes) as pool:
        for flight in as_completed([pool.submit(fly, item) for item in items]):
            yield flight.result()


def _fly_in_turn(fly: Callable[[Item], Ended], items: Sequence[Item]) -> Iterator[Ended]:
    for item in items:
        with _executor(1) as pool:
            yield pool.submit(fly, item).result()


def _executor(processes: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(processes, get_context("spawn"), logging.disable, (logging.CRITICAL,))


def _summary(results: dict[str, Result], outcomes: list[Outcome]) -> int:
    drift, ends = Drift(results), Counter(outcome.end_state for outcome in outcomes)
    flights: list[Result | Outcome] = [*results.values(), *outcomes]
    bad = [line_of(one) for one in flights if one.problems] + drift.problems
    schedules = ", ".join(f"{count} {end}" for end, count in sorted(ends.items()))
    lines = [drift.words, schedules and f"random schedules: {schedules}", *bad]
    lines.append(f"{_minutes()} {len(results)} rows and {len(outcomes)} schedules, {len(bad)} not as they must be")
    print(*filter(None, lines), sep="\n")
    return 1 if bad else 0


def _minutes() -> str:
    return f"{(time.monotonic() - BEGUN_S) / 60.0:5.1f} min"


if __name__ == "__main__":
    sys.exit(main())
