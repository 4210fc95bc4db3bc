"""The operator's commands: to the running service over MQTT, from any machine."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.text import Text

from companion.bus.telemetry import Reply
from companion.cli.asked import INTERRUPTED
from companion.cli.operate_options import Asked, commanding
from companion.cli.operate_run import operate
from companion.ports import ConfigError

_CURVES = ("ellipse", "figure8")
_SETTINGS = {"help_option_names": ["-h", "--help"]}
_DECIMALS = 6
"""Of m, rad and s: what 400 waypoints take must fit into one message."""

Height = Annotated[float | None, typer.Option(help="Above where it stands, m; as configured if not given.")]


@commanding
def arm(asked: Asked) -> None:
    """Check everything, fold the arms, offboard mode, motors at idle. Ctrl-C aborts: the motors stop."""
    operate(asked, "arm")


@commanding
def takeoff(asked: Asked, height: Height = None) -> None:
    """Climb and hold. Ctrl-C holds; before it has left the ground, the motors stop."""
    operate(asked, "takeoff", height_m=height)


@commanding
def hold(asked: Asked) -> None:
    """Brake and hover; what was flown is not taken up again. Ctrl-C leaves."""
    operate(asked, "hold")


@commanding
def _goto(
    asked: Asked,
    x: Annotated[float, typer.Argument(help="In W, m.")],
    y: Annotated[float, typer.Argument(help="In W, m.")],
    z: Annotated[float, typer.Argument(help="Above the floor, m.")],
    yaw: Annotated[float | None, typer.Option(help="Heading there, rad; as it is if not given.")] = None,
) -> None:
    """Fly to a place, then hold. Ctrl-C holds."""
    operate(asked, "goto", x_m=x, y_m=y, z_m=z, yaw_rad=yaw)


goto = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
goto.command("goto", context_settings={**_SETTINGS, "ignore_unknown_options": True})(_goto)
"""A typer of its own, because -1.5 is a place and no option."""


def _curves(incomplete: str) -> list[str]:
    files = [str(path) for path in sorted(Path().glob(f"{incomplete}*.csv"))]
    return [name for name in (*_CURVES, *files) if name.startswith(incomplete)]


@commanding
def track(
    asked: Asked,
    path: Annotated[str, typer.Argument(help="ellipse, figure8, or a CSV file of waypoints.", autocompletion=_curves)],
    laps: Annotated[int | None, typer.Option(help="Of a curve; 2 if not given.")] = None,
    size: Annotated[float | None, typer.Option(help="Of a curve: 1, if not given, is 2 m across.")] = None,
    period: Annotated[float | None, typer.Option(help="Of a lap, s; 15 if not given.")] = None,
    height: Annotated[float | None, typer.Option(help="Of a curve, in W, m; as it is if not given.")] = None,
    arms: Annotated[str | None, typer.Option(help="A motion of config/arms/ that begins with it.")] = None,
) -> None:
    """Go to a trajectory's start, fly it, hold its end; meanwhile the arms may move. Ctrl-C holds."""
    curve: dict[str, Any] = {"laps": laps, "size": size, "period_s": period, "height_m": height}
    if path in _CURVES:
        operate(asked, "track", curve=path, arms=arms, **curve)
    given = [name.removesuffix("_s").removesuffix("_m") for name, value in curve.items() if value is not None]
    if given:
        raise ConfigError(f"--{given[0]} is of ellipse and figure8: the waypoints of {path} say all of it")
    operate(asked, "track", waypoints=_waypoints(path), arms=arms)


def _waypoints(name: str) -> list[dict[str, float]]:
    from companion.trajectory_files import Curve, read_waypoints, trajectory_named  # noqa: PLC0415 - numpy takes time

    path = Path(name)
    if not path.exists():
        trajectory_named(name, Curve())  # says what would be right
    read = read_waypoints(path)
    table = zip(read.times_s, read.positions_w_m, read.yaws_rad, strict=True)
    return [
        {
            "t_s": round(float(t_s), _DECIMALS),
            **{axis: round(float(value), _DECIMALS) for axis, value in zip(("x_m", "y_m", "z_m"), place, strict=True)},
            "yaw_rad": round(float(yaw_rad), _DECIMALS),
        }
        for t_s, place, yaw_rad in table
    ]


@commanding
def controller(
    asked: Asked, name: Annotated[str, typer.Argument(help="etnn, pid, or another name of config/controllers/.")]
) -> None:
    """Fly with another control law from now on, in the air too, without a bump. Ctrl-C leaves."""
    operate(asked, "controller", name=name)


@commanding
def land(asked: Asked) -> None:
    """Arms folded, down where it is, disarmed. Ctrl-C leaves, the landing goes on."""
    operate(asked, "land")


@commanding
def abort(asked: Asked) -> None:
    """Land now, or stop the motors on the ground; the record says that you did. Ctrl-C leaves, it goes on."""
    operate(asked, "abort")


@commanding
def resume(asked: Asked) -> None:
    """Take the vehicle back from PX4 or its pilot, and hover where it is. Ctrl-C leaves, it goes on."""
    operate(asked, "resume")


@commanding
def disarm(asked: Asked) -> None:
    """Motors off, on the ground only. Ctrl-C leaves."""
    operate(asked, "disarm")


@commanding
def kill(asked: Asked, yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False) -> None:
    """Stop the motors at once: in the air the vehicle FALLS. Asks to type kill."""
    if not yes:
        if not sys.stdin.isatty():
            raise ConfigError("kill stops the motors in the air: say --yes where nobody can be asked")
        try:
            typed = typer.prompt("this stops the motors, in the air it falls; type kill", err=True)
        except typer.Abort:
            typer.echo("\ncompanion: interrupted, nothing was sent", err=True)
            raise typer.Exit(INTERRUPTED) from None
        if typed.strip() != "kill":
            raise ConfigError(f"{typed.strip()!r} is not kill: nothing was sent")
    operate(asked, "kill", confirm="kill")


@commanding
def params(asked: Asked) -> None:
    """Print the configuration, the law's gains and the autopilot's parameters that are in force."""
    operate(asked, "params", show=_show_params)


def _show_params(reply: Reply, console: Console) -> None:
    for line in _flat(reply.data, ""):
        console.print(Text(line))


def _flat(value: Any, name: str) -> list[str]:
    if isinstance(value, dict) and value:
        return [line for key, one in value.items() for line in _flat(one, f"{name}.{key}" if name else str(key))]
    return [f"{name} = {value}"]
