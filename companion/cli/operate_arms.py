"""`companion arms live`: the arms of the running service, over MQTT."""

from typing import Annotated

import typer

from companion.cli.operate_options import Asked, commanding
from companion.cli.operate_run import operate

live = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@live.callback()
def arms_live() -> None:
    """The same arms while the service runs and has the bus: commands over MQTT, in flight too."""


@live.command()
@commanding
def ready(asked: Asked) -> None:
    """Torque on, then folded; on the ground."""
    operate(asked, "arms", do="ready")


@live.command()
@commanding
def stow(asked: Asked) -> None:
    """Fold both arms."""
    operate(asked, "arms", do="stow")


@live.command()
@commanding
def play(asked: Asked, motion: Annotated[str, typer.Argument(help="A name in config/arms/ of the service.")]) -> None:
    """Play a motion; in hold, too. Ctrl-C stops it."""
    operate(asked, "arms", do="play", motion=motion)


@live.command()
@commanding
def hold(asked: Asked) -> None:
    """Come to rest and stay there, torque on."""
    operate(asked, "arms", do="hold")


@live.command()
@commanding
def limp(asked: Asked) -> None:
    """Torque off, on the ground: the arms FALL, so support them."""
    operate(asked, "arms", do="limp")


@live.command()
@commanding
def clear(asked: Asked) -> None:
    """Forget the servos' faults; say ready before they move again."""
    operate(asked, "arms", do="clear")
