"""`companion sweep`: robustness of a controller over many vehicles that differ from its model."""

import hashlib
import json
import math
import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console, RenderableType
from rich.markup import escape

from companion.cli import complete
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.cli.options import LawOn, Place, RadioLink, SummaryFile, check_link
from companion.cli.output import check_output
from companion.cli.studies.backend import Fresh, Jobs, OnCluster, backend_of
from companion.cli.terminal import numbers_table, progress_bar
from companion.config.controller_config import controller_path
from companion.config.locations import project_root
from companion.simulation.virtual_link import radio_named, words_of
from companion.simulation.workers import Backend
from companion.studies.sweep.sweep import ERROR, Columns, Sweep
from companion.studies.sweep.sweep_numbers import (
    Blame,
    Group,
    blames,
    errors_m,
    group,
    nominals,
    of_nominal,
    parameters,
)
from companion.studies.sweep.sweep_run import Parts, Swept, run, write_table


def sweep(
    vehicles: Annotated[int, typer.Option(min=1, max=1_000_000, help="Number of vehicles.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random vehicles, noise and disturbances.")] = 1,
    controller: Annotated[
        str,
        typer.Option(
            help="etnn, pid, another name in config/controllers/, or a TOML file.", autocompletion=complete.controllers
        ),
    ] = "practical",
    law_on: LawOn = Place.BOARD,
    link: RadioLink = None,
    on: OnCluster = None,
    jobs: Jobs = None,
    out: Annotated[Path, typer.Option(help="Write parts, table and picture into this folder.")] = Path("flights/sweep"),
    summary: SummaryFile = None,
    fresh: Fresh = False,
) -> None:
    """Fly vehicles that differ from the companion's model, in virtual time, and print what the errors depend on.

    Finished parts are kept: after Ctrl-C (exit code 130) the same command continues, and more --vehicles add to them.
    Exit code 1 if any vehicle diverged or was landed by PX4, 2 if the sweep could not be flown.
    """
    console, backend = Console(), backend_of(on, jobs)
    check_output(out / "parts", summary)
    check_link(law_on, link)
    plan = Sweep(vehicles=vehicles, seed=seed, controller=controller, link=_link(law_on, link))
    try:
        swept = _run(plan, out / "parts", backend, fresh, console)
    except KeyboardInterrupt:
        kept = Parts(plan, out / "parts").finished
        console.print(
            f"[yellow]interrupted[/]: {kept} of {vehicles} vehicles are kept in {escape(str(out))}; the same command "
            "goes on",
            soft_wrap=True,
        )
        raise typer.Exit(INTERRUPTED) from None
    _report(console, swept)
    console.print(f"{escape(controller)} flew {escape(swept.engine)}", highlight=False, soft_wrap=True)
    _keep(console, plan, swept.columns, out)
    if summary is not None:
        text = json.dumps(_summary(plan, swept), indent=2, allow_nan=False)
        summary.write_text(text + "\n", encoding="utf-8")
    lost = swept.columns["diverged"].any() or _landed(swept.columns) > 0
    raise typer.Exit(FAILED if lost else 0)


def _link(law_on: Place, link: str | None) -> str | None:
    """Return the sentence of the radio, `clean` for a perfect one; None for a law on board."""
    return words_of(radio_named(link)) if law_on is Place.GROUND else None


def _landed(columns: Columns) -> int:
    """Return the number of vehicles that PX4 has landed, as their law on the ground was not heard."""
    return int(columns["landed"].sum()) if "landed" in columns else 0


def _run(plan: Sweep, parts: Path, backend: Backend, fresh: bool, console: Console) -> Swept:
    with progress_bar(console) as bar:
        task = bar.add_task("vehicles", total=plan.vehicles)
        return run(plan, parts, backend, fresh, lambda flown: bar.update(task, completed=int(flown)))


def _report(console: Console, swept: Swept) -> None:
    columns = swept.columns
    console.print(_errors(columns))
    console.print(_what_hurts(columns))
    console.print(_worst(columns), highlight=False, soft_wrap=True)
    if "landed" in columns:
        bytes_per_s, messages_per_s = (float(columns[f"link_{name}_per_s"].mean()) for name in ("bytes", "messages"))
        text = f"link {messages_per_s:.0f} messages/s, {bytes_per_s:.0f} bytes/s up; landed by PX4: {_landed(columns)}"
        console.print(text, highlight=False)
    before = f", {swept.taken_over} of them by an earlier run" if swept.taken_over else ""
    console.print(f"{len(columns['vehicle'])} vehicles in {swept.seconds:.0f} s{before}", highlight=False)


def _errors(columns: Columns) -> RenderableType:
    rows = []
    for nominal in nominals(columns):
        of = group(of_nominal(columns, nominal))
        errors = (
            f"{100.0 * value:.2f}" if math.isfinite(value) else "lost"
            for value in (of.error_p50_m, of.error_p95_m, of.error_max_m)
        )
        rows.append((f"{nominal:.1f} rad/s", str(of.vehicles), str(of.diverged), *errors, f"{of.update_share:.1%}"))
    headings = ("bandwidth", "vehicles", "diverged", "median", "95 %", "worst", "updates")
    return numbers_table("error of the whole flight (cm), norm of the axes' means", headings, rows)


def _what_hurts(columns: Columns) -> RenderableType:
    each = [blames(of_nominal(columns, nominal)) for nominal in nominals(columns)]
    ranked = sorted(zip(*each, strict=True), key=lambda row: -sum(np.nan_to_num([one.explained for one in row])))
    return numbers_table(
        "variance of the errors' ranks that a parameter explains, and rank correlation",
        ("parameter", *(f"{nominal:.1f} rad/s" for nominal in nominals(columns))),
        [(parameters(columns)[row[0].parameter], *(_words(blame) for blame in row)) for row in ranked],
    )


def _words(blame: Blame) -> str:
    share = "-" if math.isnan(blame.explained) else f"{blame.explained:.0%}"
    return f"{share:>4} {blame.correlation:+6.2f}" if math.isfinite(blame.correlation) else f"{share:>4}      -"


def _worst(columns: Columns) -> str:
    row = int(np.argmax(errors_m(columns)))
    names = {"nominal_radps": "nominal bandwidth (rad/s)"} | parameters(columns)
    drawn = ", ".join(f"{label} {_value(columns[name][row])}" for name, label in names.items())
    how = "diverged" if columns["diverged"][row] else f"error {100.0 * columns[ERROR][row]:.2f} cm"
    return f"worst: vehicle {columns['vehicle'][row]}, {how}: {drawn}"


def _value(value: Any) -> str:
    return str(value) if isinstance(value, str) else f"{value:.4g}"


def _keep(console: Console, plan: Sweep, columns: Columns, out: Path) -> None:
    """Write the table of all vehicles and the picture."""
    from companion.studies.sweep.sweep_plots import plot_sweep  # noqa: PLC0415 - matplotlib takes a second to import

    name, over = f"{_label(plan.controller)}-seed{plan.seed}", ""
    if plan.link is not None:
        name, over = f"{name}-ground-{re.sub(r'[^a-z0-9.]+', '-', plan.link)}", f", over {plan.link}"
    named = Path(plan.controller).name
    title = f"{plan.vehicles} vehicles that differ from the model of {named}, seed {plan.seed}{over}"
    with console.status("drawing"):
        write_table(out / f"{name}.npz", columns)
        plot_sweep(columns, title, [out / f"{name}{suffix}" for suffix in (".png", ".pdf")])
    shown = escape(str(out / name))
    console.print(f"picture [bold]{shown}.png[/] and .pdf, table {shown}.npz", soft_wrap=True)


def _label(controller: str) -> str:
    """Return a controller's name for file names; a user's file gets a hash of its path, as names may repeat."""
    path = controller_path(controller).resolve()
    if path.parent == (project_root() / "config" / "controllers").resolve():
        return path.stem
    return f"{path.stem}-{hashlib.sha256(str(path).encode()).hexdigest()[:6]}"


def _summary(plan: Sweep, swept: Swept) -> dict[str, Any]:
    groups = {f"{nominal:.1f}": group(of_nominal(swept.columns, nominal)) for nominal in nominals(swept.columns)}
    return {
        "vehicles": len(swept.columns["vehicle"]),
        "diverged": int(swept.columns["diverged"].sum()),
        "seconds": round(swept.seconds, 3),
        "vehicle_seconds": round(swept.vehicle_seconds, 3),
        "taken_over": swept.taken_over,
        "controller": plan.controller,
        "seed": plan.seed,
        "law_on": "board" if plan.link is None else "ground",
        "link": plan.link,
        **({} if plan.link is None else _link_summary(swept.columns)),
        "error": ERROR,
        **{name: _by_nominal(groups, name) for name in ("error_p50_m", "error_p95_m", "error_max_m", "update_share")},
    }


def _link_summary(columns: Columns) -> dict[str, float]:
    return {
        "uplink_bytes_per_s": float(columns["link_bytes_per_s"].mean()),
        "messages_per_s": float(columns["link_messages_per_s"].mean()),
        "landed_by_px4": _landed(columns),
    }


def _by_nominal(groups: dict[str, Group], name: str) -> dict[str, float | None]:
    """Return one number of each group; None where it is infinite because vehicles diverged."""
    values = {nominal: float(getattr(of, name)) for nominal, of in groups.items()}
    return {nominal: value if math.isfinite(value) else None for nominal, value in values.items()}
