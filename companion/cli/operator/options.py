"""Options that all operator commands share."""

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from companion.client.endpoint import BROKER, CA_FILE, PASSWORD_FILE, VEHICLE, Given

EXIT_CODES = (
    "Exit codes: 0 done, 1 begun and failed, 2 refused or bad input, 3 no service, 4 no answer or unknown outcome, "
    "130 interrupted."
)
_PANEL = "Where the service is"

Broker = Annotated[
    str | None,
    typer.Option(
        help=f"Connect to a broker: mqtt://HOST or mqtts://USER@HOST:PORT.  [default: ${BROKER}, else this computer]",
        rich_help_panel=_PANEL,
        metavar="URL",
    ),
]
Vehicle = Annotated[
    str | None,
    typer.Option(
        help=f"Address a vehicle: VEHICLE or PREFIX/VEHICLE.  [default: ${VEHICLE}, else dauam/vehicle]",
        rich_help_panel=_PANEL,
        metavar="NAME",
    ),
]
PasswordFile = Annotated[
    str | None,
    typer.Option(
        help=f"Read the password from a file.  [default: ${PASSWORD_FILE}]",
        rich_help_panel=_PANEL,
        metavar="FILE",
    ),
]
CaFile = Annotated[
    str | None,
    typer.Option(
        help=f"Trust the certificate authority in this PEM file.  [default: ${CA_FILE}]",
        rich_help_panel=_PANEL,
        metavar="FILE",
    ),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config", help="Read all of this from [operator] in this file.", rich_help_panel=_PANEL, metavar="FILE"
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object a line, and nothing else.")]
NoWait = Annotated[
    bool, typer.Option("--no-wait", help="Return once the service has accepted it; do not wait for its end.")
]
Timeout = Annotated[
    float | None,
    typer.Option(
        min=0.1,
        help="Stop waiting after S seconds (exit code 4); the vehicle continues.",
        metavar="S",
    ),
]


@dataclass(frozen=True)
class CommandOptions:
    """Options of an operator's command: the broker, the output, how long to wait."""

    given: Given
    as_json: bool
    wait: bool = True
    timeout_s: float = math.inf


def looking(command: Callable[..., None]) -> Callable[..., None]:
    """Give `command` the options of one that only looks; its first parameter is `CommandOptions`."""

    def parameters(
        broker: Broker = None,
        vehicle: Vehicle = None,
        password_file: PasswordFile = None,
        ca_file: CaFile = None,
        config: ConfigFile = None,
        as_json: AsJson = False,
    ) -> CommandOptions:
        return CommandOptions(Given(broker, vehicle, password_file, ca_file, config), as_json)

    return _with_options(command, parameters)


def commanding(command: Callable[..., None]) -> Callable[..., None]:
    """Give `command` the options of one that is executed and waited for; its first parameter is `CommandOptions`."""

    def parameters(
        broker: Broker = None,
        vehicle: Vehicle = None,
        password_file: PasswordFile = None,
        ca_file: CaFile = None,
        config: ConfigFile = None,
        as_json: AsJson = False,
        no_wait: NoWait = False,
        timeout: Timeout = None,
    ) -> CommandOptions:
        given = Given(broker, vehicle, password_file, ca_file, config)
        return CommandOptions(given, as_json, not no_wait, math.inf if timeout is None else timeout)

    return _with_options(command, parameters)


def _with_options(command: Callable[..., None], parameters: Callable[..., CommandOptions]) -> Callable[..., None]:
    """Return a function whose signature, which typer reads, has both: the command's own parameters first."""
    own = list(inspect.signature(command).parameters.values())[1:]
    shared = list(inspect.signature(parameters).parameters.values())
    names = [one.name for one in shared]

    def called(**given: Any) -> None:
        options = parameters(**{name: given.pop(name) for name in names})
        command(options, **given)

    together = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in [*own, *shared]]
    called.__signature__ = inspect.Signature(together)  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in together}
    called.__name__, called.__doc__ = command.__name__, f"{inspect.getdoc(command)}\n\n{EXIT_CODES}"
    return called
