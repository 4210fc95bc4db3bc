"""`companion experiments`: the paper's two experiments in virtual time, with the paper's numbers."""

import json
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from rich.console import Console
from rich.markup import escape
from rich.text import Text

from companion.analysis.report.tables import BAD, FAINT, GOOD
from companion.cli import complete
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED, names_of, seeds_of
from companion.cli.options import AllowUnstable, LawOn, Place, RadioLink, SummaryFile, check_link
from companion.cli.output import check_output
from companion.cli.studies.backend import Fresh, Jobs, OnCluster, backend_of, local_jobs
from companion.cli.terminal import numbers_table, progress_bar
from companion.config.controller_config import controller_path
from companion.config.locations import project_root
from companion.config.text_files import read_text
from companion.core.interfaces import ConfigError
from companion.simulation.scene import HorizonError, experiment_names
from companion.simulation.virtual_link import radio_named, words_of
from companion.simulation.workers import Backend, in_parallel
from companion.studies.paper import campaign_table as words
from companion.studies.paper.campaign import (
    BASELINE,
    Flown,
    Item,
    fly_job,
    job_of,
    label_of,
    scene_of,
    variants_of,
    whole_items,
)

Result = TypeVar("Result")

_ADVICE = "what is flown is kept, the same command goes on from there; try fewer --jobs or fewer --seeds"
_TONES = {GOOD: "green", BAD: "red", FAINT: "dim"}


@dataclass(frozen=True)
class Campaign:
    """Checked request: the experiments, laws and seeds to fly."""

    experiments: tuple[str, ...]
    controllers: tuple[str, ...]
    wholes: tuple[Item, ...]
    """The complete laws; all alike but for experiment and law."""
    variants: tuple[Item, ...]

    @property
    def command(self) -> str:
        """The command line that repeats this campaign."""
        one = self.wholes[0]
        bandwidth = [] if one.bandwidth_radps is None else ["--bandwidth", f"{one.bandwidth_radps:g}"]
        bandwidth += [] if one.horizon is None else ["--horizon", one.horizon]
        lists = ["--experiments", ",".join(self.experiments), "--controllers", ",".join(self.controllers)]
        seeds = ["--seeds", f"{one.seeds[0]}:{one.seeds[-1]}"]
        unstable = ["--allow-unstable"] if one.allow_unstable else []
        ground = [] if one.radio is None else ["--law-on", "ground", "--link", words_of(one.radio)]
        return shlex.join(["companion", "experiments", *lists, *seeds, *bandwidth, *ground, *unstable])


@dataclass(frozen=True)
class _Run:
    """Computers that fly a campaign, and the folder of its results."""

    backend: Backend
    jobs: int
    """Number of processes of this computer, for drawing."""
    out: Path
    fresh: bool


def experiments(
    names: Annotated[
        str,
        typer.Option(
            "--experiments",
            help="Names in config/experiments/ or TOML files, comma-separated.",
            autocompletion=complete.listed(complete.experiments),
        ),
    ] = "ellipse,figure8",
    controllers: Annotated[
        str,
        typer.Option(
            help="Names in config/controllers/ or TOML files, comma-separated; pid is always flown.",
            autocompletion=complete.listed(complete.controllers),
        ),
    ] = "practical,paper-repaired,geometric-pid,indi,l1,mpc,pid",
    allow_unstable: AllowUnstable = False,
    seeds: Annotated[str, typer.Option(help="One seed, or FIRST:LAST (inclusive): one vehicle for each seed.")] = "1:5",
    bandwidth: Annotated[
        float | None,
        typer.Option(min=2.0, max=40.0, help="Bandwidth of roll and pitch, rad/s; the recorded PX4 has 6.3."),
    ] = None,
    horizon: Annotated[
        HorizonError | None,
        typer.Option(help="Replace the experiments' error of the autopilot's horizon; px4-...: as recorded."),
    ] = None,
    law_on: LawOn = Place.BOARD,
    link: RadioLink = None,
    out: Annotated[Path, typer.Option(help="Write parts, the report and its figures into this folder.")] = Path(
        "flights/experiments"
    ),
    summary: SummaryFile = None,
    ablations: Annotated[bool, typer.Option(help="Also fly each law without one of its parts.")] = True,
    report: Annotated[bool, typer.Option(help="Draw the figures and write the report.")] = True,
    on: OnCluster = None,
    jobs: Jobs = None,
    fresh: Fresh = False,
) -> None:
    """Fly the paper's experiments in virtual time with both arms swinging; compare the errors with the paper's.

    Exit codes: 0 no vehicle lost and every flight of every complete law inside its error limits; 1 not so; 2 could
    not be flown; 130 after Ctrl-C. Finished parts are kept: the same command continues.
    """
    console, backend = Console(), backend_of(on, jobs)
    try:
        laws = tuple(map(_baseline_or_own, _listed(controllers, "controllers")))
        chosen = _listed(names, "experiments")
        check_link(law_on, link)
        radio = radio_named(link) if law_on is Place.GROUND else None
        items = whole_items(chosen, laws, seeds_of(seeds), bandwidth, allow_unstable, horizon)
        wholes = tuple(replace(item, radio=radio) for item in items)
        variants = tuple(variant for item in wholes for variant in variants_of(item))
        campaign = Campaign(chosen, laws, wholes, variants if ablations else ())
        check_output(out / "parts", summary)
        run = _Run(backend, local_jobs(jobs), out, fresh)
        raise typer.Exit(_run(campaign, console, run, report, summary))
    except KeyboardInterrupt:
        raise typer.Exit(INTERRUPTED) from None


def _run(campaign: Campaign, console: Console, run: _Run, report: bool, summary: Path | None) -> int:
    tasks = [job_of(item) for item in (*campaign.wholes, *campaign.variants)]
    flying = in_parallel(fly_job, tasks, run.backend, _ADVICE, run.out / "parts", run.fresh)
    doing = f"flying, {len(campaign.wholes[0].seeds)} vehicles each"
    done, interrupted = _each(flying, len(tasks), console, doing)
    flights = [done[number] for number in sorted(done)]
    _print_all(campaign, flights, console)
    if summary is not None and flights:
        data = words.summary(flights) | {"complete": not interrupted}
        summary.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    if not interrupted and report:
        interrupted = _write_report(campaign, flights, console, run)
    if interrupted:
        said = f"[yellow]interrupted[/] after {len(flights)} of {len(tasks)} flights; the same command goes on"
        console.print(said, highlight=False)
        return INTERRUPTED
    return _verdict([flown for flown in flights if not flown.item.variant], console)


def _listed(text: str, option: str) -> tuple[str, ...]:
    """Split a list of names; ConfigError for a name given twice: the summary could not tell them apart."""
    names = names_of(text, option)
    (label, count), *_ = Counter(map(label_of, names)).most_common(1)
    if count > 1:
        raise ConfigError(f"--{option} {text}: {label} is given {count} times, give each name once")
    return names


def _baseline_or_own(name: str) -> str:
    """Return the name; BASELINE for the baseline's file, ConfigError for another file of that name."""
    if label_of(name) != BASELINE or name == BASELINE:
        return name
    if controller_path(name).samefile(controller_path(BASELINE)):
        return BASELINE
    raise ConfigError(
        f"--controllers {name}: {BASELINE} is the name of the baseline, which is always flown: rename the file"
    )


def _each(
    results: Iterator[tuple[int, Result]], total: int, console: Console, doing: str
) -> tuple[dict[int, Result], bool]:
    """Wait for all results with a progress bar; return them by task number, and whether Ctrl-C ended it."""
    done: dict[int, Result] = {}
    try:
        with progress_bar(console) as bar:
            shown = bar.add_task(doing, total=total)
            for number, result in results:
                done[number] = result
                bar.advance(shown)
    except KeyboardInterrupt:
        return done, True
    return done, False


def _print_all(campaign: Campaign, flights: Sequence[Flown], console: Console) -> None:
    explained: set[str] = set()
    for experiment in campaign.experiments:
        here = [flown for flown in flights if flown.item.experiment == experiment]
        wholes = [flown for flown in here if not flown.item.variant]
        if not any(flown.item.controller == BASELINE for flown in wholes):
            continue  # interrupted before there was anything to compare with
        grids = [words.comparison(wholes), words.events(wholes)]
        for whole in wholes:
            variants = [f for f in here if f.item.variant and f.item.controller == whole.item.controller]
            grids += [words.ablation_grid(whole, variants).narrow] if variants else []
        for grid in grids:
            rows = [[Text(cell.text, style=_TONES.get(cell.tone, "")) for cell in row] for row in grid.rows]
            console.print(numbers_table(grid.title, grid.columns, rows))
            if grid.note not in explained:
                console.print(grid.note, markup=False, highlight=False)
            explained.add(grid.note)
        for flown in wholes:
            if flown.link is not None:
                console.print(f"{label_of(flown.item.controller)}: {flown.link}", markup=False, highlight=False)


def _write_report(campaign: Campaign, flights: Sequence[Flown], console: Console, run: _Run) -> bool:
    """Write figures and page; return whether Ctrl-C ended it."""
    from companion.studies.paper.campaign_detail import look_at_job  # noqa: PLC0415
    from companion.studies.paper.campaign_plots import draw_experiment  # noqa: PLC0415
    from companion.studies.paper.campaign_report import Chapter, Source, page  # noqa: PLC0415
    from companion.studies.paper.descriptions import facts_of  # noqa: PLC0415
    from companion.studies.paper.network_and_proof import closer  # noqa: PLC0415 - matplotlib takes a second to import

    jobs = [job_of(item) for item in campaign.wholes]
    looking = in_parallel(look_at_job, jobs, run.backend, _ADVICE)
    looked, interrupted = _each(looking, len(jobs), console, "recomputing the first seed in detail")
    if interrupted:
        return True
    closely = [looked[number] for number in sorted(looked)]
    details = [[one for one in closely if one.item.experiment == name] for name in campaign.experiments]
    drawing = in_parallel(partial(draw_experiment, folder=run.out), details, Backend(run.jobs), _ADVICE)
    drawn, interrupted = _each(drawing, len(details), console, "drawing")
    if interrupted:
        return True
    chapters = []
    for number, (name, mine) in enumerate(zip(campaign.experiments, details, strict=True)):
        scene = scene_of(next(item for item in campaign.wholes if item.experiment == name))
        here = [flown for flown in flights if flown.item.experiment == name]
        wholes, variants = ([f for f in here if bool(f.item.variant) == changed] for changed in (False, True))
        chapters.append(Chapter(scene.title, facts_of(scene), wholes, variants, closer(mine), drawn[number]))
    sources = [Source(path, read_text(path)) for path in _files(campaign)]
    file = run.out / "report.html"
    file.write_text(page(chapters, sources, campaign.command), encoding="utf-8")
    console.print(
        f"report [bold]{escape(str(file))}[/], figures beside it as PNG and PDF", soft_wrap=True, highlight=False
    )
    return False


def _files(campaign: Campaign) -> list[Path]:
    """Return the files of the experiments and controllers."""
    folder, known = project_root() / "config" / "experiments", experiment_names()
    flown = [folder / f"{name}.toml" if name in known else Path(name) for name in campaign.experiments]
    return [*flown, *dict.fromkeys(controller_path(item.controller) for item in campaign.wholes)]


def _verdict(wholes: Sequence[Flown], console: Console) -> int:
    """Print a sentence for each law outside its limits; return the exit code."""
    bad = [flown for flown in wholes if not flown.good]
    for flown in bad:
        count = len(flown.item.seeds)
        what = (
            f"lost {flown.diverged} of {count}"
            if flown.diverged
            else f"landed by PX4 with {flown.landed} of {count} seeds, as nothing came from the ground"
            if flown.landed
            else f"outside its error limits with {flown.outside} of {count} seeds"
        )
        where = f"{label_of(flown.item.controller)} on {label_of(flown.item.experiment)}"
        console.print(Text(f"{where}: {what}", style="red"), highlight=False)
    return FAILED if bad else 0
