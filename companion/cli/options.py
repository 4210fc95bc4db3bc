"""Options that several commands have."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from companion.cli.complete import controllers
from companion.config.arms_config import Feedforward
from companion.config.companion_config import CompanionConfig, load_config
from companion.config.locations import INSTALLED, default_config_path, vehicle_config_path
from companion.config.toml_files import read_toml
from companion.core.interfaces import ConfigError

ControllerName = Annotated[
    str | None,
    typer.Option(
        help="etnn, pid, another name in config/controllers/, or a TOML file.  [default: as configured]",
        autocompletion=controllers,
    ),
]
AllowUnstable = Annotated[
    bool,
    typer.Option("--allow-unstable", help="Fly a controller file although its stability margin is too small."),
]
ArmsFeedforward = Annotated[
    Feedforward | None, typer.Option(help="Feed the arms' motion forward to the law.  [default: as configured]")
]
VehicleConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config",
        metavar="FILE",
        help=f"Companion configuration.  [default: {INSTALLED} where it is installed, else config/lab.toml]",
    ),
]
SummaryFile = Annotated[Path | None, typer.Option(help="Write the numbers as JSON.")]


class Place(StrEnum):
    """Place where the control law runs."""

    BOARD = "board"
    GROUND = "ground"


LawOn = Annotated[Place, typer.Option("--law-on", help="Run the control law on board, or on the ground.")]
RadioLink = Annotated[
    str | None,
    typer.Option(
        "--link",
        metavar="SENTENCE",
        help="With --law-on ground: impair the radio between both: 'loss 10% jitter 20 ms', 'loss 30% burst 100 ms "
        "delay 5 ms'.",
    ),
]

_OF_THE_MOCK = frozenset({"mavlink", "qualisys"})
"""Tables that only the mock's configuration has."""


def check_link(law_on: Place, link: str | None) -> None:
    """Raise ConfigError for a link of a law that is on board."""
    if link is not None and law_on is Place.BOARD:
        raise ConfigError(f"--link {link!r}: there is no such link with the law on board: give --law-on ground")


def settings_of(given: Path | None, usual: str) -> CompanionConfig:
    """Return the companion's configuration: the given file, else the `usual` one of config/; ConfigError."""
    return _settings(given or default_config_path(usual))


def vehicle_settings(given: Path | None, logs: bool = False) -> CompanionConfig:
    """Return the configuration of a vehicle; print its file's name on standard error when no file was given.

    The default is the vehicle's own file where the service is installed, else config/lab.toml. A command that `logs`
    names the file in its log instead. Raises ConfigError.
    """
    path = given or vehicle_config_path()
    if given is None and not logs:
        typer.echo(f"companion: configuration {path}", err=True)
    return _settings(path)


def _settings(path: Path) -> CompanionConfig:
    if _OF_THE_MOCK & read_toml(path).keys():
        raise ConfigError(f"{path}: this is the mock's configuration; give the companion's, demo.toml or lab.toml")
    return load_config(path)
