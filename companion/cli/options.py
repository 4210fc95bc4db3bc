"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

from companion.config_arms import Feedforward

ControllerName = Annotated[
    str | None, typer.Option(help="etnn, pid, another name in config/controllers/, or a TOML file.")
]
AllowUnstable = Annotated[
    bool, typer.Option("--allow-unstable", help="Fly a controller file that is refused as unstable.")
]
ArmsFeedforward = Annotated[
    Feedforward | None, typer.Option(help="What the law is told of the arms' motion; as configured if not given.")
]
SummaryFile = Annotated[Path | None, typer.Option(help="Write the numbers as JSON.")]
