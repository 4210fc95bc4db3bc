"""`companion tune`: search gains for few updates and small errors, and check them on flights outside of the search."""

import json
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape

from companion.cli import complete
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED, names_of
from companion.cli.options import SummaryFile
from companion.cli.output import check_file, check_output
from companion.cli.studies.backend import Fresh, Jobs, OnCluster, backend_of
from companion.cli.terminal import numbers_table, progress_bar
from companion.config.controller_config import PEERS, read_controller, read_etnn
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.simulation.scene import Scene, load_scene
from companion.simulation.workers import Workers, workers
from companion.studies.tuning.etnn_space import ETNN, EtnnSpace
from companion.studies.tuning.gain_space import START, GainSpace, rounded, shares_of, values_from
from companion.studies.tuning.peer_space import PeerSpace
from companion.studies.tuning.search import (
    CHECK_SEED,
    ERROR_M,
    UPDATES,
    Centre,
    Generation,
    Plan,
    Point,
    front_of,
    marks_of,
    scenes_of,
    search,
    trials_of,
)
from companion.studies.tuning.tuning import WORST_M, shortened
from companion.trajectories.reference import Ellipse, FigureEight, LapTiming

_ADVICE = "what is flown is kept, the same command goes on from there; try fewer --jobs"
_CHECK_VEHICLES = (2, 6)
_YARDSTICK = "practical"
"""Law that a search is compared with unless --start names another: the default of a flight."""


@dataclass(frozen=True)
class Checked:
    """Check of a rounded centre outside of the search: means over loops, curves and vehicles."""

    centre: Centre
    values: dict[str, float]
    error_m: float
    other_m: float
    worst_m: float
    update_share: float

    @property
    def point(self) -> Point:
        """The point (update share, error) for the Pareto front."""
        return self.update_share, self.error_m

    @property
    def distance(self) -> float:
        """Distance to the target: error as configured, updates, and a third of the other vehicles' error."""
        return self.error_m / ERROR_M + self.update_share / UPDATES + 0.3 * self.other_m / ERROR_M


def tune(
    write: Annotated[Path | None, typer.Option(help="Write the best gains into this controller file.")] = None,
    generations: Annotated[int, typer.Option(min=1, max=2000, help="Generations of each search.")] = 60,
    population: Annotated[int, typer.Option(min=4, max=200, help="Sets of gains in a generation.")] = 20,
    weights: Annotated[
        str, typer.Option(help="Weights of updates against errors, comma-separated; one search for each.")
    ] = "0.8,1.2",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the searches and of their noise.")] = 1,
    step: Annotated[
        float, typer.Option(min=0.005, max=0.3, help="Spread of the first generation, as a share of each range.")
    ] = 0.04,
    start: Annotated[
        str | None,
        typer.Option(
            help="Start from this controller, ET-NN or one with [tune]: a name or a TOML file.",
            autocompletion=complete.controllers,
        ),
    ] = None,
    experiments: Annotated[
        str,
        typer.Option(
            help="Train on these experiments, comma-separated.", autocompletion=complete.listed(complete.experiments)
        ),
    ] = "ellipse,figure8",
    bandwidths: Annotated[
        str, typer.Option(help="Train on these attitude bandwidths, rad/s, comma-separated.")
    ] = "6.3,10,12",
    on: OnCluster = None,
    jobs: Jobs = None,
    out: Annotated[Path, typer.Option(help="Write parts, progress and picture into this folder.")] = Path(
        "flights/tune"
    ),
    summary: SummaryFile = None,
    fresh: Fresh = False,
) -> None:
    """Search gains by CMA-ES with swinging arms, several attitude loops and vehicles that differ from their model.

    Every generation flies new seeds. The centres are then checked on seeds and curves that no search flew, and compared
    with the law to beat (--start, else practical); --write keeps the best. After Ctrl-C (exit code 130) the same
    command continues.
    """
    console, backend = Console(), backend_of(on, jobs)
    plan = _plan(generations, population, weights, seed, experiments, bandwidths)
    plan = replace(plan, step=step, space=_space(start, write))
    begin = START if start is None else _from_file(start)
    _check_outputs(out, summary, write)
    progress: list[tuple[Generation, Array]] = []
    try:
        with workers(backend, _ADVICE, out / "parts", fresh) as crew:
            centres = _search(plan, begin, crew, progress, console, out)
            yardstick = Centre(shares_of(_from_file(start or _YARDSTICK), plan.space.knobs), 0.0, 0)
            with console.status("checking on seeds and curves that no search flew"):
                *checked, known = _check([*centres, yardstick], plan, crew)
    except KeyboardInterrupt:
        kept = f"; their centres are in {out / 'generations.json'}, the same command goes on" if progress else ""
        console.print(f"interrupted after {len(progress)} generations{kept}", markup=False, highlight=False)
        raise typer.Exit(INTERRUPTED) from None
    best = best_of(checked, plan.space)
    _print(console, checked, best, known, start or _YARDSTICK)
    with console.status("drawing"):
        _draw([generation for generation, _ in progress], checked, best, out / "front.png")
    if best is None:
        console.print(
            "[red]no centre held every vehicle[/]: nothing is written; search longer, or from a better --start"
        )
        raise typer.Exit(FAILED)
    console.print(f"picture [bold]{escape(str(out / 'front.png'))}[/]", soft_wrap=True)
    if summary is not None:
        _summarise(checked, summary)
    if write is not None:
        options: dict[str, object] = {
            "generations": generations,
            "population": population,
            "weights": weights,
            "seed": seed,
            "step": step,
        }
        options |= {"experiments": experiments, "bandwidths": bandwidths, "start": start}
        write.write_text(plan.space.toml(best.values, _command(options)), encoding="utf-8")
        console.print(f"wrote [bold]{escape(str(write))}[/]")


def _plan(generations: int, population: int, weights: str, seed: int, experiments: str, bandwidths: str) -> Plan:
    loops = _numbers("bandwidths", bandwidths, 2.0, 40.0)
    scenes = scenes_of([shortened(load_scene(name)) for name in names_of(experiments, "experiments")], loops)
    return Plan(
        scenes=scenes,
        loops=len(loops),
        generations=generations,
        population=population,
        weights=_numbers("weights", weights, 0.05, 20.0),
        seed=seed,
    )


def _check_outputs(out: Path, summary: Path | None, write: Path | None) -> None:
    check_output(out, summary)
    if write is not None:
        check_file(write, "write")


def _search(
    plan: Plan,
    begin: dict[str, float],
    crew: Workers,
    progress: list[tuple[Generation, Array]],
    console: Console,
    out: Path,
) -> list[Centre]:
    with _bar(console, plan) as bar:

        def note(generation: Generation, centre: Array) -> None:
            progress.append((generation, centre))
            _keep(out, progress, plan.space)
            bar(len(progress), generation)

        return search(plan, shares_of(begin, plan.space.knobs), crew, note)


def _space(start: str | None, write: Path | None) -> GainSpace:
    """Return the search space of the law that a search starts from."""
    files = read_controller(start or _YARDSTICK)
    if files.tables.get("law") in PEERS:
        return PeerSpace(files)
    name = "" if write is None else write.name
    title = "The law that flies." if name == "practical.toml" else "A tuned ET-NN law."
    return EtnnSpace(title, f"the ET-NN law of {name}, found by companion tune")


def _from_file(name: str) -> dict[str, float]:
    files = read_controller(name)
    if files.tables.get("law") in PEERS:
        return PeerSpace(files).start
    file = read_etnn(files)
    return values_from(file.gains, file.prediction)


def _command(options: dict[str, object]) -> str:
    """Return the command line that repeats the search; output and number of processes make no difference."""
    given = [(f"--{name}", str(value)) for name, value in options.items() if value is not None]
    return shlex.join(["companion", "tune", *(part for pair in given for part in pair)])


def _numbers(option: str, text: str, least: float, most: float) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if not values or any(not least <= value <= most for value in values):
        raise ConfigError(f"--{option} {text}: must be comma-separated numbers from {least:g} to {most:g}")
    return values


@contextmanager
def _bar(console: Console, plan: Plan) -> Iterator[Any]:
    total = plan.generations * len(plan.weights)
    with progress_bar(console) as bar:
        task = bar.add_task("searching", total=total)

        def step(done: int, last: Generation) -> None:
            note = f"weight {last.weight:g}: {100.0 * last.error_m:.2f} cm, {last.update_share:.1%} updates"
            bar.update(task, completed=done, description=note)

        yield step


def _check(centres: Sequence[Centre], plan: Plan, crew: Workers) -> list[Checked]:
    """Fly the centres on curves and seeds that no search flew; return their checks."""
    knobs = plan.space.knobs
    values = [rounded(one.shares, knobs) for one in centres]
    points = np.array([shares_of(value, knobs) for value in values])
    scenes = [elsewhere(scene) for scene in plan.scenes]
    marks = marks_of(trials_of(scenes, CHECK_SEED, _CHECK_VEHICLES, plan.space), points, crew)
    error, other, updates = (
        np.mean([getattr(mark, name) for mark in marks], axis=0).tolist()
        for name in ("error_m", "other_m", "update_share")
    )
    worst = np.max([mark.worst_m for mark in marks], axis=0).tolist()
    return [
        Checked(one, value, error_m=here, other_m=there, worst_m=most, update_share=share)
        for one, value, here, there, most, share in zip(centres, values, error, other, worst, updates, strict=True)
    ]


def best_of(checked: Sequence[Checked], space: GainSpace = ETNN) -> Checked | None:
    """Return the one nearest to the target that held every vehicle and is not refused by the loader, if any."""
    flies = (one for one in checked if one.worst_m < WORST_M and space.stable(one.values))
    return min(flies, key=lambda one: one.distance, default=None)


def elsewhere(scene: Scene) -> Scene:
    """Return the scene with a curve of other size, orientation and period in the same room."""
    centre = np.asarray(scene.trajectory.at(0.0).position_w_m * [0.0, 0.0, 1.0])
    kind, axes, period_s = (
        (FigureEight, (0.6, 0.6), 18.0) if isinstance(scene.trajectory, FigureEight) else (Ellipse, (0.7, 1.0), 12.0)
    )
    return replace(scene, trajectory=kind(centre, axes, LapTiming(period_s, 1, 4.0)))


def verdict(best: Checked, known: Checked, name: str) -> str:
    """Return in words whether the best of a search is better than the known law `name`."""
    numbers = f"(worst case {100.0 * best.worst_m:.1f} cm, {name} {100.0 * known.worst_m:.1f} cm)"
    if best.distance < known.distance:
        return f"the best of this search is better than {name} {numbers}"
    return f"the best of this search is NOT better than {name} {numbers}: search longer before you fly it"


def _print(console: Console, checked: Sequence[Checked], best: Checked | None, known: Checked, name: str) -> None:
    front, rows = front_of([one.point for one in checked]), []
    for one in (*checked, known):
        found = f"weight {one.centre.weight:g}, generation {one.centre.generation}"
        errors = (f"{100.0 * error_m:.2f}" for error_m in (one.error_m, one.other_m, one.worst_m))
        mark = "best" if one is best else "front" if one.point in front else ""
        rows.append((name if one is known else found, *errors, f"{one.update_share:.1%}", "" if one is known else mark))
    columns = ("", "nominal", "other vehicles", "worst", "updates", "")
    console.print(numbers_table("errors on seeds and curves that no search flew (cm)", columns, rows))
    if best is not None:
        console.print(verdict(best, known, name), highlight=False, markup=False, soft_wrap=True)


def _draw(progress: Sequence[Generation], checked: Sequence[Checked], best: Checked | None, path: Path) -> None:
    from companion.studies.tuning.tuning_plot import plot_search  # noqa: PLC0415 - matplotlib takes a second to import

    plot_search(progress, [one.point for one in checked], best.point if best else None, path)


def _keep(out: Path, progress: Sequence[tuple[Generation, Array]], space: GainSpace) -> None:
    """Write all generations so far, so that an interrupt loses none."""
    rows = [asdict(generation) | {"centre": rounded(centre, space.knobs)} for generation, centre in progress]
    (out / "generations.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def _summarise(checked: Sequence[Checked], path: Path) -> None:
    names = ("error_m", "other_m", "worst_m", "update_share", "values")
    rows = [{name: getattr(one, name) for name in names} for one in checked]
    path.write_text(json.dumps({"checked": rows}, indent=2) + "\n", encoding="utf-8")
