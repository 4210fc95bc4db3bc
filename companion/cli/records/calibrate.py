"""`companion calibrate`: parameters of vehicle and room from a hover flight."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from companion.cli.operator.exit_codes import FAILED
from companion.cli.working import working
from companion.records.errors import UnfitFlightError

if TYPE_CHECKING:
    from rich.console import Console

    from companion.analysis.calibration.calibration import Calibrated, Finding

_FAR_SD = 3.0
_WHAT_NOW = """
differs: by more than three standard deviations from the configuration that the flight was flown with.
Set setpoint_delay_s, attitude_bandwidth_radps and attitude_damping together: they are one fit, and another set of
the three can describe the same vehicle about as well (for the mock's demo.toml they always differ: docs/reports.md,
"How good it is"). After a change of the delays by more than a few ms, fly the law in simulation with them
(companion simulate --demo --config FILE), and tune it again where it is worse (companion tune)."""


def calibrate_command(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT", help="Record of a hover, better with climbs and descents.")
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Identify hover thrust, thrust curve, attitude response and delays, as lines for the configuration.

    Prints each value with its standard deviation and the configured value, and which values the flight cannot show.
    Changes nothing. Exit codes: 0 found, 1 the flight shows nothing, 2 the file is no record of a flight.
    """
    from rich.console import Console  # noqa: PLC0415 - nothing that --help would wait for

    try:
        found = _calibrated(flight)
    except UnfitFlightError as error:
        typer.echo(f"companion: {error}", err=True)
        raise typer.Exit(FAILED) from error
    if as_json:
        typer.echo(json.dumps(summary_of(found)))
    else:
        _show(found, Console())
    raise typer.Exit(0 if found.findings else FAILED)


def _calibrated(flight: Path) -> "Calibrated":
    from companion.analysis.calibration.calibration import calibrate  # noqa: PLC0415
    from companion.analysis.calibration.signals import observed  # noqa: PLC0415
    from companion.analysis.replay.laws import config_of  # noqa: PLC0415
    from companion.analysis.report.recorded_flight import Flown  # noqa: PLC0415
    from companion.records.read import read_flight  # noqa: PLC0415

    with working(f"reading {flight.name}"):
        record = read_flight(flight)
        config = config_of(record)
        seen = observed(Flown(record))
    with working("fitting"):
        return calibrate(seen, config)


def summary_of(found: "Calibrated") -> dict[str, object]:
    """Return the findings for --json: found values, values left out, TOML lines."""
    return {
        "found": {
            one.name: {"value": one.value, "sd": one.sd, "configured": one.configured, "says": one.says}
            for one in found.findings
        },
        "left_out": {one.name: one.why for one in found.left},
        "toml": found.toml(),
    }


def _show(found: "Calibrated", console: "Console") -> None:
    from rich.table import Table  # noqa: PLC0415

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
    if any(_differs(one) for one in found.findings):
        console.print(_WHAT_NOW, markup=False, highlight=False)


def _far(one: "Finding") -> str:
    """Return a mark for a finding that differs from the configured value, else nothing."""
    return "[yellow]differs[/]: " if _differs(one) else ""


def _differs(one: "Finding") -> bool:
    return abs(one.value - one.configured) > _FAR_SD * one.sd
