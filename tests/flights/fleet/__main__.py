"""Random flights of several vehicles over many seeds: `python -m tests.flights.fleet --vehicles 2 --seeds 100`.

Real flight loops, guards, supervisors and laws in simulated time, in one room of the mock, each with an operator that
gives random commands, also across the others, and with troubles of single vehicles. Exit code 1 when separation was
lost, two collided, or one with something to do was blocked for more than 10 s.
"""

import argparse
import json
import logging
import math
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tests.flights.fleet.virtual import Order, Outcome, fly_seed

BEGUN_S = time.monotonic()


def main(arguments: list[str] | None = None) -> int:
    """Return 0 when no seed has a problem."""
    options = _parser().parse_args(arguments)
    seeds = [options.seed] if options.seed is not None else range(options.first, options.first + options.seeds)
    trail = options.seed is not None
    orders = [Order(seed, options.vehicles, 60.0 * options.minutes, options.faults, trail) for seed in seeds]
    outcomes: list[Outcome] = []
    for outcome in _fly(orders, options.workers):
        outcomes = sorted([*outcomes, outcome], key=lambda one: one.seed)
        if options.json is not None:  # each time, as hours of flights may be broken off
            options.json.write_text(json.dumps([_plain(one) for one in outcomes], indent=1), encoding="utf-8")
    if trail and outcomes[0].trail:
        print(*outcomes[0].trail, sep="\n")
    print(*table(outcomes), sep="\n")
    return 1 if any(outcome.problems for outcome in outcomes) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.flights.fleet", description=__doc__)
    parser.add_argument("--vehicles", type=int, default=2, metavar="N")
    parser.add_argument("--seeds", type=int, default=100, metavar="N", help="number of seeds")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="the first seed")
    parser.add_argument("--seed", type=int, metavar="SEED", help="one seed alone, and what all did in its last seconds")
    parser.add_argument("--minutes", type=float, default=5.0, help="simulated time of each seed")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes")
    parser.add_argument("--no-faults", dest="faults", action="store_false", help="no trouble of single vehicles")
    parser.add_argument("--json", type=Path, metavar="FILE", help="where to write the outcomes")
    return parser


def _fly(orders: Sequence[Order], workers: int) -> Iterator[Outcome]:
    """Yield what became of each seed as it ends, and print a line of it; BrokenProcessPool when a process crashes."""
    spawn, quiet = get_context("spawn"), (logging.CRITICAL,)
    with ProcessPoolExecutor(workers, spawn, logging.disable, quiet) as pool:
        flights = [pool.submit(fly_seed, order) for order in orders]
        for number, flight in enumerate(as_completed(flights), 1):
            outcome = flight.result()
            print(
                f"{(time.monotonic() - BEGUN_S) / 60.0:6.1f} min {number}/{len(flights)}: {line(outcome)}", flush=True
            )
            yield outcome


def line(outcome: Outcome) -> str:
    """Return one seed's outcome."""
    moves = outcome.counts.get("move accepted", 0)
    words = (
        f"seed {outcome.seed}: {moves} moves, {outcome.flown_m:.0f} m, least clearance "
        f"{outcome.closest.clearance_m:.2f} m, blocked at most {outcome.blocked.for_s:.1f} s, {outcome.cpu_s:.1f} s CPU"
    )
    return f"{words}: {'; '.join(outcome.problems)}" if outcome.problems else words


def table(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the summary of all seeds."""
    counts = _sum(outcome.counts for outcome in outcomes)
    faults = _sum(outcome.faults for outcome in outcomes)
    refusals = _sum(outcome.refusals for outcome in outcomes)
    troubles = Counter(" ".join(said.split()[3:]).rpartition(" in ")[0] for one in outcomes for said in one.incidents)
    hours = sum(outcome.vehicles * outcome.for_s for outcome in outcomes) / 3600.0
    closest = min(outcomes, key=lambda outcome: outcome.closest.clearance_m)
    longest = max(outcomes, key=lambda outcome: outcome.blocked.for_s)
    bad = [outcome for outcome in outcomes if outcome.problems]
    rows = [
        ("seeds, vehicles, minutes", f"{len(outcomes)}, {outcomes[0].vehicles}, {outcomes[0].for_s / 60.0:g}"),
        ("vehicle hours, distance flown", f"{hours:.1f} h, {sum(one.flown_m for one in outcomes) / 1000.0:.1f} km"),
        ("CPU", f"{sum(one.cpu_s for one in outcomes) / 60.0:.1f} min"),
        ("least clearance to a cylinder", f"{closest.closest.clearance_m:.3f} m (seed {closest.seed})"),
        ("separation lost", f"{sum(len(one.lost) for one in outcomes)} times"),
        ("collisions", str(sum(len(one.collisions) for one in outcomes))),
        ("longest blocked", f"{longest.blocked.for_s:.1f} s (seed {longest.seed}, {longest.blocked.body})"),
        ("longest wait for a takeoff", f"{max(outcome.stood_s for outcome in outcomes):.1f} s"),
        ("troubles", _listed(troubles)),
        ("commands", _listed(counts)),
        ("faults that began", _listed(faults)),
        ("refusals", _listed(refusals)),
        ("seeds with a problem", f"{len(bad)}: {', '.join(str(one.seed) for one in bad)}" if bad else "none"),
    ]
    return ["", *(f"| {name} | {text} |" for name, text in rows), "", *(line(one) for one in bad)]


def _sum(counts: Any) -> Counter[str]:
    total: Counter[str] = Counter()
    for one in counts:
        total.update(one)
    return total


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{number} {name}" for name, number in counts.most_common()) or "none"


def _plain(outcome: Outcome) -> Any:
    """Return an outcome for JSON, which has no infinity."""
    return _finite(asdict(outcome) | {"problems": outcome.problems})


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    sys.exit(main())
