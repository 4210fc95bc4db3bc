"""`companion arms live`: the arms of the running service, over MQTT."""

from typing import Annotated

import typer

from companion.cli.complete import service_motions
from companion.cli.operator.options import CommandOptions, with_waiting
from companion.cli.operator.run import operate, without_arguments

ready = without_arguments("arms", "Switch torque on, then fold the arms; on the ground only.", do="ready")
stow = without_arguments("arms", "Fold both arms as for take-off and landing.", do="stow")
hold = without_arguments("arms", "Stop the arms and hold them there, torque on.", do="hold")
limp = without_arguments("arms", "Switch torque off, on the ground only: the arms FALL, so support them.", do="limp")
clear = without_arguments(
    "arms", "Clear the servos' faults; `arms live ready` is needed before they move again.", do="clear"
)


@with_waiting
def play(
    options: CommandOptions,
    motion: Annotated[
        str,
        typer.Argument(help="swing, or another name in the service's config/arms/.", autocompletion=service_motions),
    ],
) -> None:
    """Play a motion, in flight also during hold. Ctrl-C stops it."""
    operate(options, "arms", do="play", motion=motion)
