"""`companion arms live`: the arms of the running service, over MQTT."""

from typing import Annotated

import typer

from companion.cli.complete import service_motions
from companion.cli.operator.options import Asked, commanding
from companion.cli.operator.run import operate


@commanding
def ready(asked: Asked) -> None:
    """Switch torque on, then fold the arms; on the ground only."""
    operate(asked, "arms", do="ready")


@commanding
def stow(asked: Asked) -> None:
    """Fold both arms as for take-off and landing."""
    operate(asked, "arms", do="stow")


@commanding
def play(
    asked: Asked,
    motion: Annotated[
        str,
        typer.Argument(help="swing, or another name in the service's config/arms/.", autocompletion=service_motions),
    ],
) -> None:
    """Play a motion, in flight also during hold. Ctrl-C stops it."""
    operate(asked, "arms", do="play", motion=motion)


@commanding
def hold(asked: Asked) -> None:
    """Stop the arms and hold them there, torque on."""
    operate(asked, "arms", do="hold")


@commanding
def limp(asked: Asked) -> None:
    """Switch torque off, on the ground only: the arms FALL, so support them."""
    operate(asked, "arms", do="limp")


@commanding
def clear(asked: Asked) -> None:
    """Clear the servos' faults; `arms live ready` is needed before they move again."""
    operate(asked, "arms", do="clear")
