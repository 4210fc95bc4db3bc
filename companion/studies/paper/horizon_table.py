"""Errors under each horizon that the autopilot may have, with the companion's correction and without it.

`python -m companion.studies.paper.horizon_table` prints the table of docs/experiments.md, seeds 1 to 20: minutes.
`companion experiments --horizon px4-a` flies one of them, every law and ablation.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from companion.core.interfaces import CompanionError
from companion.simulation.scene import HorizonError
from companion.simulation.workers import Backend, in_parallel
from companion.studies.paper.campaign import BASELINE, Flown, Item, fly
from companion.studies.paper.campaign_table import reductions
from companion.studies.paper.paper_table import PAPER

SEEDS = tuple(range(1, 21))


@dataclass(frozen=True, kw_only=True)
class Setting:
    """A vehicle on its experiments, and the attitude loop it has there."""

    name: str
    experiments: tuple[str, str]
    bandwidth_radps: float | None = None


SETTINGS = (
    Setting(name="10 rad/s", experiments=("ellipse", "figure8")),
    Setting(name="6.3 rad/s", experiments=("ellipse", "figure8"), bandwidth_radps=6.3),
    Setting(name="recorded, 1 kg", experiments=("px4-ellipse", "px4-figure8")),
)
HEAD = (
    "| vehicle | horizon | ellipse: norm | worst seed | sent | uncorrected | figure-eight: norm | worst seed | sent "
    "| uncorrected | reduced |\n" + "| --- " * 11 + "|"
)


def row_items(setting: Setting, horizon: HorizonError, controller: str, seeds: tuple[int, ...]) -> list[Item]:
    """Return a row's flights: on each experiment the law, the same uncorrected, and the paper's baseline."""
    ours = [
        Item(
            experiment=experiment,
            controller=controller,
            seeds=seeds,
            bandwidth_radps=setting.bandwidth_radps,
            horizon=horizon,
        )
        for experiment in setting.experiments
    ]
    bare = [replace(item, corrected=False) for item in ours]
    return [*ours, *bare, *(replace(item, controller=BASELINE) for item in ours if item.experiment in PAPER)]


def row(setting: Setting, horizon: HorizonError, controller: str, flights: Sequence[Flown]) -> str:
    """Return a row in Markdown."""
    cells, reached, cells_in_all = [setting.name, str(horizon)], 0, 0
    for experiment in setting.experiments:
        here = [flown for flown in flights if flown.item.experiment == experiment]
        ours, bare = (
            next(f for f in here if f.item.controller == controller and f.item.corrected == corrected)
            for corrected in (True, False)
        )
        lost = f", lost {ours.diverged}" if ours.diverged else ""
        cells += [f"{ours.error_m:.4f}{lost}", f"{ours.score.error_m.max():.4f}", f"{ours.update_share:.1%}"]
        cells.append(f"{bare.error_m:.4f}, {bare.update_share:.1%}")
        if experiment in PAPER:
            baseline = next(f for f in here if f.item.controller == BASELINE)
            wanted = (*PAPER[experiment].mean_reduced_percent, *PAPER[experiment].max_reduced_percent)
            reached += int((reductions(ours, baseline) >= wanted).sum())
            cells_in_all += len(wanted)
    return f"| {' | '.join([*cells, f'{reached} of {cells_in_all}' if cells_in_all else ''])} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly every row and print it as soon as it is complete."""
    parser = argparse.ArgumentParser(prog="python -m companion.studies.paper.horizon_table", description=__doc__)
    parser.add_argument("--controller", default="practical", help="a name in config/controllers/ or a TOML file")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many, from 1 on")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="processes")
    asked = parser.parse_args(arguments)
    seeds = tuple(range(1, asked.seeds + 1))
    rows = [(setting, horizon) for setting in SETTINGS for horizon in HorizonError]
    flown = in_order([row_items(*one, asked.controller, seeds) for one in rows], asked.jobs)
    print(HEAD, flush=True)
    for one, flights in zip(rows, flown, strict=True):
        print(row(*one, asked.controller, flights), flush=True)


def in_order(rows: Sequence[Sequence[Item]], jobs: int) -> Iterator[list[Flown]]:
    """Yield each row's flights as soon as it and those before it are complete."""
    done: dict[int, Flown] = {}
    results = in_parallel(
        fly, [item for items in rows for item in items], Backend(jobs), "give fewer --jobs or --seeds"
    )
    first = 0
    for of_row in rows:
        numbers = range(first, first + len(of_row))
        while not all(number in done for number in numbers):
            done.update([next(results)])
        yield [done[number] for number in numbers]
        first += len(of_row)


if __name__ == "__main__":
    try:
        main()
    except CompanionError as error:
        sys.exit(str(error))
