"""`companion arms`: the servos of both arms on the bench, without autopilot and motion capture."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from companion.cli import complete
from companion.cli.arms.bench import Bench, bench_of, run
from companion.cli.arms.carry_out import From, How, carry_out
from companion.cli.arms.plan import grip_wish, play_wish, pose_wish
from companion.cli.arms.servos import clear_servos, ping_servos, read_servos, switch_torque
from companion.cli.option_groups import Group, with_group
from companion.cli.options import VehicleConfigFile
from companion.core.types import Array

PortOption = Annotated[str | None, typer.Option("--port", help="Use this serial port instead of the configured one.")]
_MOVING: Group = {
    "config": VehicleConfigFile,
    "port": PortOption,
    "yes": Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before moving.")],
    "dry_run": Annotated[bool, typer.Option("--dry-run", help="Plan and print only, without servos.")],
    "start": Annotated[From | None, typer.Option("--from", help="Start pose of a dry run.  [default: stow]")],
    "plot": Annotated[Path | None, typer.Option("--plot", help="Draw the plan into this PNG file.")],
}
_FLOOR: Group = {
    "floor_z_m": Annotated[
        float | None,
        typer.Option(
            "--floor-z",
            max=0.0,
            help="Height of the floor in the body frame, m, such as -0.3.  [default: [arms] stands_at_m]",
        ),
    ],
}


@dataclass(frozen=True)
class MovingOptions:
    """Bench and options of a moving command."""

    bench: Bench
    how: How


def _collect(config: Path | None, port: str | None, floor_z_m: float | None = None, **how: Any) -> MovingOptions:
    bench = bench_of(config, port)
    return MovingOptions(bench, How(floor_z_m=bench.floor(floor_z_m), **how))


def _moving(command: Callable[..., None]) -> Callable[..., None]:
    """Give `command` the options of one that moves the arms; its first parameter is `MovingOptions`."""
    return with_group(command, {**_MOVING, **_FLOOR}, _collect)


class Claws(StrEnum):
    """States that claws can be moved to."""

    OPEN = "open"
    CLOSE = "close"


class Switch(StrEnum):
    """States of the joints' torque."""

    ON = "on"
    OFF = "off"


def ping(config: VehicleConfigFile = None, port: PortOption = None) -> None:
    """List every servo, or everything that is missing or wrong. Changes nothing."""
    run(ping_servos(bench_of(config, port), Console()))


def read(
    config: VehicleConfigFile = None,
    port: PortOption = None,
    once: Annotated[bool, typer.Option("--once", help="Print one table and end.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON document and end.")] = False,
) -> None:
    """Show the state of every servo, live until Ctrl-C, missing and broken ones included. Changes nothing.

    With --once or --json the exit code is 1 when anything is wrong.
    """
    bench, console = bench_of(config, port), Console()
    raise typer.Exit(run(read_servos(bench, console, once or as_json or not console.is_terminal, as_json)))


@_moving
def home(options: MovingOptions) -> None:
    """Move both arms to the pose they work from, claws closed."""
    _to_pose("home", options.bench.arms.home_rad(), options)


@_moving
def stow(options: MovingOptions) -> None:
    """Fold both arms as for take-off and landing, claws closed."""
    _to_pose("stow", options.bench.arms.stow_rad(), options)


def _to_pose(name: str, pose_rad: Array, options: MovingOptions) -> None:
    wish = pose_wish(name, options.bench.arms, pose_rad, options.how.floor_z_m)
    carry_out(options.bench, wish, options.how)


@_moving
def play(
    options: MovingOptions,
    motion: Annotated[
        str,
        typer.Argument(
            help="swing, another name in config/arms/, or a TOML or CSV file of joint motion.",
            autocompletion=complete.motions,
        ),
    ],
    duration: Annotated[
        float | None, typer.Option(min=0.1, max=3600.0, help="Duration of sinusoids, s.  [default: their file's]")
    ] = None,
    repeat: Annotated[int, typer.Option(min=1, max=100, help="Play the motion this many times.")] = 1,
) -> None:
    """Play a motion; the arms move to its start first."""
    wish = play_wish(motion, options.bench.arms, duration, repeat, options.how.floor_z_m)
    carry_out(options.bench, wish, options.how)


def _grip(options: MovingOptions, claws: Annotated[Claws, typer.Argument(help="open or close")]) -> None:
    """Open or close both claws; nothing else moves."""
    poses = options.bench.arms.poses
    angle_rad = poses.claw_open_rad if claws is Claws.OPEN else poses.claw_closed_rad
    carry_out(options.bench, grip_wish(f"grip {claws}", options.bench.arms, angle_rad), options.how)


grip = with_group(_grip, _MOVING, _collect)


def torque(
    switch: Annotated[Switch, typer.Argument(help="on or off")],
    config: VehicleConfigFile = None,
    port: PortOption = None,
) -> None:
    """Hold every joint where it is, or let all go limp: then the arms FALL, so support them.

    Off also reaches the healthy servos of a bus on which others are missing or broken. No confirmation is asked for.
    """
    run(switch_torque(bench_of(config, port), on=switch is Switch.ON))


def clear(config: VehicleConfigFile = None, port: PortOption = None) -> None:
    """Clear latched faults, and print what is still wrong.

    A servo that had a fault is limp afterwards, so support the arms.
    """
    run(clear_servos(bench_of(config, port)))
