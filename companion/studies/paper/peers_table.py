"""Errors of all laws on each vehicle, with and without their event triggers.

`python -m companion.studies.paper.peers_table` prints the table of docs/experiments.md, seeds 1 to 20: minutes.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace

from companion.core.interfaces import CompanionError
from companion.studies.paper.ablations import Ablation, parts_of
from companion.studies.paper.campaign import BASELINE, Flown, Item, label_of
from companion.studies.paper.horizon_table import SEEDS, SETTINGS, Setting, in_order

LAWS = ("practical", "geometric-pid", "indi", "l1", "mpc", BASELINE)
HEAD = (
    "| vehicle | law | trigger | ellipse: norm | worst seed | sent | figure-eight: norm | worst seed | sent |\n"
    + "| --- " * 9
    + "|"
)


def row_items(setting: Setting, law: str, seeds: tuple[int, ...]) -> Iterator[list[Item]]:
    """Yield the flights of a law's rows: on each experiment the whole law; then both without its trigger."""
    whole = [
        Item(experiment=experiment, controller=law, seeds=seeds, bandwidth_radps=setting.bandwidth_radps)
        for experiment in setting.experiments
    ]
    yield whole
    if Ablation.TRIGGER in parts_of(law):
        yield [replace(item, without=Ablation.TRIGGER) for item in whole]


def row(setting: Setting, flights: Sequence[Flown]) -> str:
    """Return a row in Markdown."""
    item = flights[0].item
    trigger = "off" if item.without else "none" if item.controller == BASELINE else "on"
    cells = [setting.name, f"`{label_of(item.controller)}`", trigger]
    for flown in flights:
        lost = f", lost {flown.diverged}" if flown.diverged else ""
        cells += [f"{flown.error_m:.4f}{lost}", f"{flown.score.error_m.max():.4f}", f"{flown.update_share:.1%}"]
    return f"| {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly every row and print it as soon as it and those before it are complete."""
    parser = argparse.ArgumentParser(prog="python -m companion.studies.paper.peers_table", description=__doc__)
    parser.add_argument("--controllers", default=",".join(LAWS), help="names or TOML files, comma-separated")
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many, from 1 on")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="processes")
    asked = parser.parse_args(arguments)
    seeds, laws = tuple(range(1, asked.seeds + 1)), asked.controllers.split(",")
    rows = [(setting, items) for setting in SETTINGS for law in laws for items in row_items(setting, law, seeds)]
    print(HEAD, flush=True)
    for (setting, _), flights in zip(rows, in_order([items for _, items in rows], asked.jobs), strict=True):
        print(row(setting, flights), flush=True)


if __name__ == "__main__":
    try:
        main()
    except CompanionError as error:
        sys.exit(str(error))
