"""Options that all operator commands share."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from companion.cli.complete import Completion, vehicles
from companion.cli.option_groups import Group, with_group
from companion.client.endpoint import BROKER, CA_FILE, PASSWORD_FILE, VEHICLE, EndpointOptions

_EXIT_CODES = (
    "Exit codes: 0 done, 1 begun and failed, 2 refused or bad input, 3 no service, 4 no answer or unknown outcome, "
    "130 interrupted."
)
_PANEL = "Where the service is"


def _connection(text: str, metavar: str, completion: Completion | None = None) -> Any:
    option = typer.Option(help=text, rich_help_panel=_PANEL, metavar=metavar, autocompletion=completion)
    return Annotated[str | None, option]


_PLACE: Group = {
    "broker": _connection(
        f"Connect to a broker: mqtt://HOST or mqtts://USER@HOST:PORT.  [default: ${BROKER}, else this computer]", "URL"
    ),
    "vehicle": _connection(
        f"Address a vehicle: VEHICLE or PREFIX/VEHICLE; several as A,B, or all that are online.  [default: ${VEHICLE}, "
        "else dauam/vehicle]",
        "NAME,...",
        vehicles,
    ),
    "password_file": _connection(f"Read the password from a file.  [default: ${PASSWORD_FILE}]", "FILE"),
    "ca_file": _connection(f"Trust the certificate authority in this PEM file.  [default: ${CA_FILE}]", "FILE"),
    "config": Annotated[
        Path | None,
        typer.Option(help="Read all of this from [operator] in this file.", rich_help_panel=_PANEL, metavar="FILE"),
    ],
}
_CONNECTION: Group = {
    **_PLACE,
    "as_json": Annotated[bool, typer.Option("--json", help="Print one JSON object a line, and nothing else.")],
}
_WAITING: Group = {
    "together": Annotated[
        bool | None,
        typer.Option(
            "--together/--one-by-one",
            help="Command several vehicles at once, or one after the other up to the first failure.  [default: "
            "together where it makes safe, or only looks]",
        ),
    ],
    "no_wait": Annotated[
        bool, typer.Option("--no-wait", help="Return once the service has accepted it; do not wait for its end.")
    ],
    "timeout": Annotated[
        float | None,
        typer.Option(min=0.1, help="Stop waiting after S seconds (exit code 4); the vehicle continues.", metavar="S"),
    ],
}


@dataclass(frozen=True)
class CommandOptions:
    """Options of an operator's command: the broker, the output, how long to wait."""

    endpoint: EndpointOptions
    as_json: bool
    wait: bool = True
    timeout_s: float = math.inf
    together: bool | None = None
    """Order among several vehicles; None where it is the verb's own."""


def with_connection(command: Callable[..., None]) -> Callable[..., None]:
    """Give `command` the options of one that only looks; its first parameter is `CommandOptions`."""
    return with_group(command, _CONNECTION, _collect, _EXIT_CODES)


def with_waiting(command: Callable[..., None]) -> Callable[..., None]:
    """Give `command` the options of one that is executed and waited for; its first parameter is `CommandOptions`."""
    return with_group(command, {**_CONNECTION, **_WAITING}, _collect, _EXIT_CODES)


def with_place(command: Callable[..., None]) -> Callable[..., None]:
    """Give `command` the options that say where the service is; its first parameter is `EndpointOptions`."""
    return with_group(command, _PLACE, EndpointOptions)


def _collect(
    as_json: bool,
    no_wait: bool = False,
    timeout: float | None = None,
    together: bool | None = None,
    **endpoint: Any,
) -> CommandOptions:
    timeout_s = math.inf if timeout is None else timeout
    return CommandOptions(EndpointOptions(**endpoint), as_json, not no_wait, timeout_s, together)
