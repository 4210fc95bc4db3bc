"""`companion replay`: feed a recorded flight through the controller again."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from companion.cli import complete
from companion.cli.operator.exit_codes import FAILED
from companion.cli.options import AllowUnstable
from companion.cli.output import check_file, check_folder_of, kept
from companion.cli.working import working

if TYPE_CHECKING:
    from rich.console import Console

    from companion.analysis.replay.rerun import Replayed
    from companion.records.read import FlightRecord


def replay_command(
    flight: Annotated[Path, typer.Argument(metavar="FLIGHT", help="Record, an MCAP file.")],
    controller: Annotated[
        str | None,
        typer.Option(
            help="Feed the record to this law instead: a name in config/controllers/ or a file.",
            autocompletion=complete.controllers,
        ),
    ] = None,
    allow_unstable: AllowUnstable = False,
    plot: Annotated[Path | None, typer.Option(help="Draw both commands into this PNG or PDF file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Feed a record's inputs through estimator and control law again, and compare to the last bit.

    With --controller: show what another law, or other gains, would have commanded in each cycle of this flight.
    Exit codes: 0 identical or another law was given, 1 something differs, 2 the file is no record.
    """
    from rich.console import Console  # noqa: PLC0415 - nothing that --help would wait for

    from companion.records.read import read_flight  # noqa: PLC0415

    if plot is not None:
        check_folder_of(plot, "plot")
        check_file(plot, "plot")
    with working(f"reading {flight.name}"):
        record = read_flight(flight)
    with working(f"replaying {len(record.columns['time_s'])} cycles"):
        done = _replayed(record, controller, allow_unstable)
    console = Console(stderr=as_json)
    if as_json:
        typer.echo(json.dumps(summary_of(done, record.dropped)))
    else:
        _show(done, record.dropped, controller, console)
    if plot is not None:
        _draw(done, ", ".join(record.laws), controller, plot, console)
    raise typer.Exit(0 if controller is not None or done.identical else FAILED)


def _replayed(record: "FlightRecord", controller: str | None, allow_unstable: bool) -> "Replayed":
    from companion.analysis.replay.laws import config_of, laws_of  # noqa: PLC0415
    from companion.analysis.replay.rerun import replay  # noqa: PLC0415
    from companion.flight.assembly import controller_of, with_link  # noqa: PLC0415

    config = config_of(record)
    laws, other = laws_of(record, config), None
    if controller is not None:
        up_age_s = next(iter(laws)).up_age_s if laws else 0.0
        other = controller_of(with_link(config, up_age_s), controller, allow_unstable).law
    return replay(record, config, laws, other)


def summary_of(done: "Replayed", dropped: int) -> dict[str, object]:
    """Return the numbers of a replay for --json."""
    return {
        "ticks": done.ticks,
        "flown": done.flown,
        "dropped": dropped,
        "identical": done.identical,
        "sent_recorded": done.events[0],
        "sent_again": done.events[1],
        "apart": {
            one.name: {"compared": one.compared, "differ": one.differ, "most": one.most, "rms": one.rms}
            for one in done.differences.values()
        },
    }


def _show(done: "Replayed", dropped: int, controller: str | None, console: "Console") -> None:
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    if controller is None and done.identical:
        names = len(done.differences)
        console.print(
            Text.assemble(
                ("identical", "green"), f" to the last bit: {done.flown} cycles of the law, {names} quantities"
            )
        )
        return
    table = Table(box=None, pad_edge=False)
    for title in ("quantity", "cycles", "that differ", "most", "rms", "first at"):
        table.add_column(title, justify="left" if title == "quantity" else "right")
    for one in done.differences.values():
        if one.differ or controller is not None:
            first = "" if one.first_s is None else f"{one.first_s:.2f} s"
            table.add_row(
                "command (m/s²)" if one.name == "command" else one.name,
                str(one.compared),
                str(one.differ),
                f"{one.most:.3g}",
                f"{one.rms:.3g}",
                first,
            )
    console.print(table)
    was, now = (100.0 * count / done.flown for count in done.events)
    what = "the record's law" if controller is None else controller
    console.print(
        f"updates: {was:.1f} % of the cycles in the record, {now:.1f} % by {what}", markup=False, highlight=False
    )
    if dropped:
        console.print(f"{dropped} ticks are missing in the record: their effect on the law's state is not known")


def _draw(done: "Replayed", flown: str, controller: str | None, path: Path, console: "Console") -> None:
    import numpy as np  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415 - takes a second to import

    from companion.analysis.report.charts import AXES, COLOURS  # noqa: PLC0415

    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    recorded, again = np.array(done.recorded_accel_w_mps2), np.array(done.accel_w_mps2)
    again_name = f"{controller}, given the same" if controller else f"{flown}, again"
    for place, axis in enumerate(AXES):
        axes[place].plot(done.time_s, recorded[:, place], color=COLOURS[0], label=f"{flown}, recorded")
        axes[place].plot(done.time_s, again[:, place], "--", color=COLOURS[1], lw=0.9, label=again_name)
        axes[place].set_ylabel(f"$u_{axis}$ (m/s²)")
        axes[place].grid(alpha=0.3)
    figure.align_ylabels(axes)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)
    axes[-1].set_xlabel("time in the record (s)")
    lost = kept(path, lambda to: figure.savefig(to, dpi=150))
    console.print(lost or f"plot {path}", markup=False, highlight=False, soft_wrap=True)
