"""`companion arms live`: the arms of the running service, over MQTT."""

from typing import Annotated

import typer

from companion.cli.complete import service_motions
from companion.cli.operator.options import CommandOptions, commanding
from companion.cli.operator.run import operate


@commanding
def ready(options: CommandOptions) -> None:
    """Switch torque on, then fold the arms; on the ground only."""
    operate(options, "arms", do="ready")


@commanding
def stow(options: CommandOptions) -> None:
    """Fold both arms as for take-off and landing."""
    operate(options, "arms", do="stow")


@commanding
def play(
    options: CommandOptions,
    motion: Annotated[
        str,
        typer.Argument(help="swing, or another name in the service's config/arms/.", autocompletion=service_motions),
    ],
) -> None:
    """Play a motion, in flight also during hold. Ctrl-C stops it."""
    operate(options, "arms", do="play", motion=motion)


@commanding
def hold(options: CommandOptions) -> None:
    """Stop the arms and hold them there, torque on."""
    operate(options, "arms", do="hold")


@commanding
def limp(options: CommandOptions) -> None:
    """Switch torque off, on the ground only: the arms FALL, so support them."""
    operate(options, "arms", do="limp")


@commanding
def clear(options: CommandOptions) -> None:
    """Clear the servos' faults; `arms live ready` is needed before they move again."""
    operate(options, "arms", do="clear")
