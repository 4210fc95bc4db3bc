"""`companion preflight`: by the running service, else directly from the devices."""

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from companion.cli.complete import trajectories
from companion.cli.operator.options import CommandOptions, with_waiting
from companion.cli.operator.run import operate
from companion.client.client import open_console
from companion.client.endpoint import EndpointOptions, endpoint_of
from companion.client.errors import NoServiceError
from companion.core.errors import ConfigError
from companion.protocol.check import checks_of
from companion.protocol.telemetry import Reply

if TYPE_CHECKING:
    from rich.console import Console

_PANEL = "Only where no service runs"


@with_waiting
def preflight(
    options: CommandOptions,
    trajectory: Annotated[
        str | None,
        typer.Option(
            help="Check that ellipse, figure8 or a CSV file stays inside the fence.",
            autocompletion=trajectories,
            rich_help_panel=_PANEL,
        ),
    ] = None,
    by_hand: Annotated[
        bool,
        typer.Option(
            "--by-hand",
            help="Carry the vehicle, disarmed, to compare mocap with the autopilot.",
            rich_help_panel=_PANEL,
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Write the record into this folder.  [default: as configured]", rich_help_panel=_PANEL),
    ] = None,
) -> None:
    """Check everything that must be right before arming, on the ground and disarmed, and print the remedies.

    The running service makes the checks. Without one, and without --broker and --vehicle, this command connects to
    motion capture, autopilot and arms itself, by --config (else the vehicle's own configuration); --json then prints
    one document. Nothing is commanded; only poses are sent, to the autopilot's estimator.
    """
    only_here = by_hand or trajectory is not None or out is not None
    if not only_here and _service_runs(options.endpoint):
        operate(options, "preflight", show=show_checks)
    from companion.cli.vehicle.preflight import preflight as look  # noqa: PLC0415 - a second, for all the devices' libraries

    look(options.endpoint.config, trajectory, by_hand, options.as_json, out)


def _service_runs(given: EndpointOptions) -> bool:
    """Return true also when --broker or --vehicle names one: its absence is then the answer."""
    if given.of_a_broker:
        return True
    try:
        return asyncio.run(_is_there(given))
    except ConfigError:
        return False  # reading the whole file later gives a better message


async def _is_there(given: EndpointOptions) -> bool:
    try:
        async with open_console(endpoint_of(given)) as console:
            await console.find()
    except NoServiceError:
        return False
    return True


def show_checks(reply: Reply, console: "Console") -> None:
    """Print the list of checks in a reply, without a verdict: the reply's text has it."""
    from companion.cli.vehicle.preflight import show  # noqa: PLC0415 - as above

    show(checks_of(reply.data), console, as_json=False, with_verdict=False)
