"""Price of the radio: error against bytes and messages a second of a law on the ground, by trigger and by radio.

`python -m companion.studies.paper.radio_table --page docs/radio.md --picture docs/images/radio.png` writes the table of
that page and its picture, seeds 1 to 20: minutes. `companion experiments --law-on ground --link ...` flies one radio.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from companion.config.controller_config import LoadedController
from companion.core.interfaces import CompanionError
from companion.simulation.link_numbers import LinkNumbers, link_numbers
from companion.simulation.metrics import Score, score
from companion.simulation.mission import stacked
from companion.simulation.scene import Scene
from companion.simulation.simulation import Trace, simulate
from companion.simulation.virtual_link import radio_named
from companion.simulation.virtual_record import one_of
from companion.simulation.workers import Backend, in_parallel
from companion.studies.paper.ablations import Ablation
from companion.studies.paper.campaign import Item, controller_of, job_of, scene_of

SEEDS = tuple(range(1, 21))
EXPERIMENTS = ("ellipse", "figure8")
TRIGGERS = {
    "none: every cycle": ("practical", Ablation.TRIGGER),
    "as printed": ("paper-repaired", None),
    "practical": ("practical", None),
}
"""Controller, and the part of it that is left out."""
WAY = "delay 2 ms"
"""Delay of every radio."""
_LOSSES, _JITTERS = ("", "loss 10% ", "loss 30% "), ("", " jitter 20 ms", " jitter 50 ms")
RADIOS = (*(f"{loss}{WAY}{jitter}" for loss in _LOSSES for jitter in _JITTERS), f"loss 30% burst 100 ms {WAY}")
HEAD = (
    "| trigger | radio | ellipse: norm | worst seed | figure-eight: norm | worst seed | × on board | messages/s "
    "| bytes/s | again/s | landed by PX4 |\n" + "| --- " * 11 + "|"
)

BEGIN, END = "<!-- radio: written by radio_table -->", "<!-- end of radio -->"


@dataclass(frozen=True, kw_only=True)
class Task:
    """Flights that go side by side: one law on one experiment, and radios for which the law is the same."""

    trigger: str
    experiment: str
    radios: tuple[str, ...]
    """Sentences; empty: the law is on board."""
    seeds: tuple[int, ...] = SEEDS


@dataclass(frozen=True, kw_only=True)
class Result:
    """Flights of one trigger on one experiment over one radio, one vehicle a seed."""

    trigger: str
    experiment: str
    radio: str
    """Sentence; empty: the law is on board."""
    marks: Score
    link: LinkNumbers | None
    flight_s: float
    """Duration of the trajectory."""

    @property
    def errors_m(self) -> list[float]:
        """Norm of the three axes' means (m) of each flight that reached the trajectory."""
        return [float(error) for error in self.marks.error_m if np.isfinite(error)]


def tasks(
    seeds: tuple[int, ...], radios: Sequence[str] = RADIOS, experiments: Sequence[str] = EXPERIMENTS
) -> list[Task]:
    """Return all flights; radios of one age of the commands fly side by side, as the law is made for it."""
    made = []
    for trigger in TRIGGERS:
        for experiment in experiments:
            scene = scene_of(_item(trigger, experiment, seeds))
            ages_s = {radio: round(scene.with_radio(radio_named(radio)).up_age_s, 4) for radio in radios}
            groups = [
                (),
                *(tuple(one for one in radios if ages_s[one] == age_s) for age_s in sorted(set(ages_s.values()))),
            ]
            made += [Task(trigger=trigger, experiment=experiment, radios=group, seeds=seeds) for group in groups]
    return made


def _item(trigger: str, experiment: str, seeds: tuple[int, ...], radio: str | None = None) -> Item:
    controller, without = TRIGGERS[trigger]
    named = None if radio is None else radio_named(radio)
    return Item(experiment=experiment, controller=controller, seeds=seeds, without=without, radio=named)


def fly(task: Task) -> list[Result]:
    """Fly a task; return its results in the order of the radios."""
    item = _item(task.trigger, task.experiment, task.seeds, task.radios[0] if task.radios else None)
    scene = scene_of(item)
    trace = _flown(scene, controller_of(job_of(item)), task)
    many, names = len(task.seeds), task.radios or ("",)
    parts = [one_of(trace, slice(row * many, (row + 1) * many)) for row in range(len(names))]
    return [
        Result(
            trigger=task.trigger,
            experiment=task.experiment,
            radio=name,
            marks=score(part),
            link=link_numbers([part], scene.period_s),
            flight_s=scene.trajectory.duration_s,
        )
        for name, part in zip(names, parts, strict=True)
    ]


def _flown(scene: Scene, controller: LoadedController, task: Task) -> Trace:
    pilot, seeds = scene.pilot(controller), [*task.seeds] * max(1, len(task.radios))
    if pilot.ground is not None:
        links = tuple(radio_named(radio) for radio in task.radios for _ in task.seeds)
        pilot = replace(pilot, ground=replace(pilot.ground, links=links))
    mission = stacked([scene.mission(controller.law.preview_s)] * len(seeds))
    return simulate(pilot, scene.vehicle(), mission, seeds)


def row(trigger: str, radio: str, results: Sequence[Result], board: Sequence[Result]) -> str:
    """Return a row in Markdown: one trigger over one radio on all experiments; `board` is with the law on board."""
    cells = [trigger, radio or "on board"]
    for one in results:
        cells += [f"{np.mean(one.errors_m):.4f}", f"{max(one.errors_m):.4f}"] if one.errors_m else ["–", "–"]
    links = [(one, one.link) for one in results if one.link is not None]
    if not links:
        return f"| {' | '.join([*cells, '1', *[''] * 4])} |"
    landed, flights = sum(link.landed_by_px4 for _, link in links), sum(one.marks.landed.size for one, _ in links)
    again_per_s = np.mean([link.again / one.flight_s for one, link in links])
    rates = (f"{np.mean([getattr(link, name) for _, link in links]):.0f}" for name in _RATES)
    cells += [f"{times(results, board):.2f}", *rates, f"{again_per_s:.1f}", f"{landed} of {flights}" if landed else "0"]
    return f"| {' | '.join(cells)} |"


_RATES = ("messages_per_s", "uplink_bytes_per_s")


def times(results: Sequence[Result], board: Sequence[Result]) -> float:
    """Return the error relative to the law on board, mean over the experiments."""
    return float(np.mean([np.mean(a.errors_m) / np.mean(b.errors_m) for a, b in zip(results, board, strict=True)]))


def table(results: Sequence[Result], radios: Sequence[str] = RADIOS) -> str:
    """Return the table in Markdown, trigger by trigger; what was not flown says so."""
    lines = [HEAD]
    for trigger in TRIGGERS:
        mine = [one for one in results if one.trigger == trigger]
        board = [one for one in mine if not one.radio]
        for radio in ("", *radios):
            here = [one for one in mine if one.radio == radio]
            flown = here and len(here) == len(board)
            nothing = f"| {trigger} | {radio or 'on board'} | not flown yet |{' |' * 8}"
            lines.append(row(trigger, radio, here, board) if flown else nothing)
    return "\n".join(lines)


def write_page(page: Path, written: str) -> None:
    """Write a table into a page, between its marks; CompanionError if it has none."""
    text = page.read_text(encoding="utf-8")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise CompanionError(f"{page}: has no {BEGIN!r} with {END!r} behind it")
    page.write_text(f"{before}{begin}\n\n{written}\n\n{end}{after}", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly everything, print the table and draw the picture."""
    parser = argparse.ArgumentParser(prog="python -m companion.studies.paper.radio_table", description=__doc__)
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many, from 1 on")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="processes")
    parser.add_argument("--page", type=Path, help="page that the table is written into, docs/radio.md")
    parser.add_argument("--picture", type=Path, help="file of the picture, PNG or PDF")
    asked = parser.parse_args(arguments)
    work = tasks(tuple(range(1, asked.seeds + 1)))
    done = dict(in_parallel(fly, work, Backend(asked.jobs), "give fewer --jobs or --seeds"))
    results = [one for number in sorted(done) for one in done[number]]
    print(table(results), flush=True)
    if asked.page is not None:
        write_page(asked.page, table(results))
    if asked.picture is not None:
        from companion.studies.paper.radio_plot import draw  # noqa: PLC0415 - matplotlib takes a second to import

        draw(results, asked.picture)


if __name__ == "__main__":
    try:
        main()
    except CompanionError as error:
        sys.exit(str(error))
