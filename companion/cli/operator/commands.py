"""The operator's commands to the running service, over MQTT from any machine."""

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from companion.cli.complete import controllers, service_motions, trajectories
from companion.cli.operator.exit_codes import INTERRUPTED
from companion.cli.operator.options import CommandOptions, with_waiting
from companion.cli.operator.run import operate, without_arguments
from companion.client.addresses import names_several
from companion.client.paths import CURVES, fields_of_path
from companion.core.errors import ConfigError
from companion.protocol.telemetry import Reply

if TYPE_CHECKING:
    from rich.console import Console

Height = Annotated[
    float | None, typer.Option(metavar="M", help="Height above the take-off point, m.  [default: as configured]")
]

arm = without_arguments(
    "arm", "Check everything, fold the arms, enter offboard mode, idle the motors. Ctrl-C aborts: the motors stop."
)
hold = without_arguments("hold", "Brake and hover; the trajectory is ended, not paused. Ctrl-C stops waiting.")
land = without_arguments(
    "land", "Fold the arms, land where the vehicle is, disarm. After Ctrl-C the landing continues."
)
abort = without_arguments(
    "abort", "Land now, or stop the motors on the ground; the record notes the abort. After Ctrl-C it continues."
)
resume = without_arguments(
    "resume", "Take the vehicle back from PX4 or its pilot, and hover where it is. After Ctrl-C it continues."
)
disarm = without_arguments("disarm", "Stop the motors, on the ground only. Ctrl-C stops waiting.")


@with_waiting
def takeoff(options: CommandOptions, height: Height = None) -> None:
    """Climb and hold. Ctrl-C holds; while the vehicle is still on the ground, it stops the motors."""
    operate(options, "takeoff", height_m=height)


@with_waiting
def goto(
    options: CommandOptions,
    x: Annotated[float, typer.Argument(help="Position along the room's x axis, m.")],
    y: Annotated[float, typer.Argument(help="Position along the room's y axis, m.")],
    z: Annotated[float, typer.Argument(help="Height above the floor, m.")],
    yaw: Annotated[
        float | None,
        typer.Option(metavar="RAD", help="Heading, rad, counterclockwise from +x.  [default: unchanged]"),
    ] = None,
) -> None:
    """Fly to a position, then hold. Ctrl-C holds."""
    operate(options, "goto", x_m=x, y_m=y, z_m=z, yaw_rad=yaw)


@with_waiting
def track(
    options: CommandOptions,
    path: Annotated[
        str, typer.Argument(help="ellipse, figure8, or a CSV file of waypoints.", autocompletion=trajectories)
    ],
    laps: Annotated[int | None, typer.Option(help="Laps of ellipse or figure8.  [default: 2]")] = None,
    size: Annotated[
        float | None,
        typer.Option(metavar="FACTOR", help="Size of ellipse or figure8: 1 is 2 m long, 0.5 is 1 m.  [default: 1]"),
    ] = None,
    period: Annotated[
        float | None, typer.Option(metavar="S", help="Time for one lap of ellipse or figure8, s.  [default: 15]")
    ] = None,
    height: Annotated[
        float | None,
        typer.Option(metavar="M", help="Height of ellipse or figure8 above the floor, m.  [default: current height]"),
    ] = None,
    arms: Annotated[
        str | None,
        typer.Option(
            metavar="MOTION",
            help="Move the arms during the flight: swing, or a name in the service's config/arms/.  [default: none]",
            autocompletion=service_motions,
        ),
    ] = None,
) -> None:
    """Fly to a trajectory's start, fly it and hold at its end; the arms may move meanwhile. Ctrl-C holds."""
    curve: dict[str, Any] = {"laps": laps, "size": size, "period_s": period, "height_m": height}
    given = {name: value for name, value in curve.items() if value is not None}
    if given and path not in CURVES:
        option = next(iter(given)).removesuffix("_s").removesuffix("_m")
        raise ConfigError(f"--{option} is only for ellipse and figure8: {path} defines the whole trajectory")
    operate(options, "track", arms=arms, **given, **fields_of_path(path))


@with_waiting
def controller(
    options: CommandOptions,
    name: Annotated[
        str,
        typer.Argument(
            help="etnn, pid, or another name in the service's config/controllers/.", autocompletion=controllers
        ),
    ],
) -> None:
    """Switch to another control law, in the air too. Ctrl-C stops waiting.

    The setpoint does not jump. The position can move by 0.3 m until the new law has learned the vehicle: leave that
    much room.
    """
    operate(options, "controller", name=name)


@with_waiting
def kill(
    options: CommandOptions, yes: Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")] = False
) -> None:
    """Stop the motors at once: in the air the vehicle FALLS. You must type kill to confirm."""
    if not yes:
        if not sys.stdin.isatty():
            raise ConfigError("kill stops the motors in the air: without a terminal to confirm at, add --yes")
        try:
            which = "the motors of SEVERAL vehicles" if names_several(options.endpoint) else "the motors"
            typed = typer.prompt(f"this stops {which}, in the air it falls; type kill", err=True)
        except typer.Abort:
            typer.echo("\ncompanion: interrupted, nothing was sent", err=True)
            raise typer.Exit(INTERRUPTED) from None
        if typed.strip() != "kill":
            raise ConfigError(f"{typed.strip()!r} is not kill: nothing was sent")
    operate(options, "kill", confirm="kill")


@with_waiting
def params(options: CommandOptions) -> None:
    """Print the configuration, gains and autopilot parameters that the service uses."""
    operate(options, "params", show=_show_params)


def _show_params(reply: Reply, console: "Console") -> None:
    for line in _flat(reply.data, ""):
        console.print(line, markup=False)


def _flat(value: Any, name: str) -> list[str]:
    if isinstance(value, dict) and value:
        return [line for key, one in value.items() for line in _flat(one, f"{name}.{key}" if name else str(key))]
    return [f"{name} = {value}"]
