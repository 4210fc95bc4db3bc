"""`make faults`: flies every row of the table and random schedules, prints what came of them, writes docs/safety.md."""

import argparse
import logging
import multiprocessing
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from tests.flights.faults.judge import Result
from tests.flights.faults.real import fly_real_named
from tests.flights.faults.report import FLOWN, RECOGNISED, flown, recognised, table_of, write_json, write_page
from tests.flights.faults.schedules import Outcome, fly_schedule
from tests.flights.faults.table import VIRTUAL
from tests.flights.faults.table_real import REAL
from tests.flights.faults.virtual import fly_named

SCHEDULES = 100
CONSOLE = Console()


def main(arguments: list[str] | None = None) -> int:
    """0 when every flight is as it must be."""
    options = _parser().parse_args(arguments)
    logging.disable(logging.CRITICAL)
    results = _fly_table([row.name for row in VIRTUAL if options.only in row.name])
    if not options.virtual:
        results += _fly_real([row.name for row in REAL if options.only in row.name])
    if results:
        CONSOLE.print(table_of(results))
    whole = not options.only and not options.virtual
    outcomes = [] if options.only else _fly_schedules(options.random)
    if whole:
        write_json(results, options.json)
        write_page({RECOGNISED: recognised(), FLOWN: flown((*VIRTUAL, *REAL), results)})
    bad = [result for result in results if result.problems] + [outcome for outcome in outcomes if not outcome.good]
    CONSOLE.print(f"{len(results)} flights and {len(outcomes)} random schedules, {len(bad)} not as they must be")
    return 1 if bad else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="make faults", description=__doc__)
    parser.add_argument("--only", default="", metavar="WORD", help="rows whose name contains it; writes no file")
    parser.add_argument("--virtual", action="store_true", help="in simulated time only; writes no file")
    parser.add_argument("--random", type=int, default=SCHEDULES, metavar="N", help="so many random schedules")
    parser.add_argument("--json", type=Path, default=Path("faults.json"))
    return parser


def _fly_table(chosen: Sequence[str]) -> list[Result]:
    results: dict[str, Result] = {}
    with Progress(console=CONSOLE) as progress, multiprocessing.Pool(os.cpu_count()) as workers:
        task = progress.add_task("the table, simulated time", total=len(chosen))
        for result in workers.imap_unordered(fly_named, chosen):
            results[result.name] = result
            progress.advance(task)
    return [results[name] for name in chosen]


def _fly_real(chosen: Sequence[str]) -> list[Result]:
    """One after the other, each in a fresh process: they are about time."""
    results: list[Result] = []
    with Progress(console=CONSOLE) as progress, multiprocessing.Pool(1, maxtasksperchild=1) as worker:
        task = progress.add_task("the table, real time", total=len(chosen))
        for result in worker.imap(fly_real_named, chosen):
            results.append(result)
            progress.advance(task)
    return results


def _fly_schedules(count: int) -> list[Outcome]:
    outcomes: list[Outcome] = []
    with Progress(console=CONSOLE) as progress, multiprocessing.Pool(os.cpu_count()) as workers:
        task = progress.add_task("random schedules", total=count)
        for outcome in workers.imap_unordered(fly_schedule, range(count)):
            outcomes.append(outcome)
            progress.advance(task)
            if not outcome.good:
                where = "" if outcome.inside_fence else f", {outcome.beyond_m:.2f} m outside"
                CONSOLE.print(f"[red]seed {outcome.seed}: {outcome.end_state}{where}[/]: {'; '.join(outcome.faults)}")
    ends = {end: sum(outcome.end_state == end for outcome in outcomes) for end in {o.end_state for o in outcomes}}
    CONSOLE.print(", ".join(f"{end}: {number}" for end, number in sorted(ends.items())))
    return outcomes


if __name__ == "__main__":
    sys.exit(main())
