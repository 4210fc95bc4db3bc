"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

from companion.cli.complete import controllers
from companion.config import CompanionConfig, default_config_path, load_config
from companion.config_arms import Feedforward
from companion.config_files import read_toml
from companion.ports import ConfigError

ControllerName = Annotated[
    str | None,
    typer.Option(
        help="etnn, pid, another name in config/controllers/, or a TOML file.  [default: as configured]",
        autocompletion=controllers,
    ),
]
AllowUnstable = Annotated[
    bool, typer.Option("--allow-unstable", help="Fly a controller file that is refused as unstable.")
]
ArmsFeedforward = Annotated[
    Feedforward | None, typer.Option(help="What the law is told of the arms' motion; as configured if not given.")
]
SummaryFile = Annotated[Path | None, typer.Option(help="Write the numbers as JSON.")]

_OF_THE_MOCK = frozenset({"mavlink", "qualisys"})
"""Tables that only the mock's configuration has."""


def settings_of(given: Path | None, usual: str) -> CompanionConfig:
    """The companion's configuration: the file that was given, or the usual one of config/; ConfigError."""
    path = given or default_config_path(usual)
    if _OF_THE_MOCK & read_toml(path).keys():
        raise ConfigError(f"{path}: this is the mock's configuration; give the companion's, demo.toml or lab.toml")
    return load_config(path)
