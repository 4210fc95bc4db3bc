"""`companion calibrate`: what a hover flight says about vehicle and room."""

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from companion.cli.asked import FAILED
from companion.records.read import read_flight
from companion.replay.laws import config_of
from companion.reports.calibrate.signals import observed
from companion.reports.calibrate.whole import Calibrated, Finding, calibrate
from companion.reports.flown import Flown


def calibrate_command(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT", help="A record: a hover, better with climbs and descents.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Hover thrust, thrust curve, attitude response and delays out of a flight, as lines for the configuration.

    Each with its standard deviation and beside what was configured; what the flight does not show is said to be so.
    Changes nothing. Exit code 0, 1 if the flight shows nothing, 2 for a file that is no record of a flight.
    """
    console = Console(stderr=as_json)
    with console.status("reading the record"):
        record = read_flight(flight)
        config = config_of(record)
        seen = observed(Flown(record))
    with console.status("fitting"):
        found = calibrate(seen, config)
    if as_json:
        typer.echo(json.dumps(summary_of(found)))
    else:
        _show(found, console)
    raise typer.Exit(0 if found.findings else FAILED)


def summary_of(found: Calibrated) -> dict[str, object]:
    """For a script."""
    return {
        "found": {
            one.name: {"value": one.value, "sd": one.sd, "configured": one.configured, "says": one.says}
            for one in found.findings
        },
        "left_out": {one.name: one.why for one in found.left},
        "toml": found.toml(),
    }


def _show(found: Calibrated, console: Console) -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column(no_wrap=True)
    for title in ("found", "±", "configured"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column(overflow="fold")
    for one in found.findings:
        digits = one.digits
        value, sd = f"{one.value:.{digits}f}", f"{one.sd:.{digits}f}"
        table.add_row(one.name, value, sd, f"{one.configured:g}", f"{_far(one)}{one.says}")
    if found.findings:
        console.print(table, highlight=False)
    for left in found.left:
        console.print(f"{left.name}: {left.why}", markup=False, highlight=False, soft_wrap=True)
    if found.findings:
        console.print("\nto set in the configuration:\n", highlight=False)
        console.print(found.toml(), markup=False, highlight=False, soft_wrap=True)


def _far(one: Finding) -> str:
    """Whether the configured value is another one."""
    return "[yellow]differs[/]: " if abs(one.value - one.configured) > 3.0 * one.sd else ""
