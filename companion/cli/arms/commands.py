"""`companion arms`: the servos of both arms on the bench, without autopilot and motion capture."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from companion.cli import complete
from companion.cli.arms.bench import bench_of, run
from companion.cli.arms.carry_out import From, How, carry_out
from companion.cli.arms.plan import grip_wish, play_wish, pose_wish
from companion.cli.arms.servos import clear_servos, ping_servos, read_servos, switch_torque
from companion.cli.options import VehicleConfigFile

PortOption = Annotated[str | None, typer.Option("--port", help="Use this serial port instead of the configured one.")]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before moving.")]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Plan and print only, without servos.")]
PlotOption = Annotated[Path | None, typer.Option("--plot", help="Draw the plan into this PNG file.")]
FloorOption = Annotated[
    float | None,
    typer.Option(
        "--floor-z",
        max=0.0,
        help="Height of the floor in the body frame, m, such as -0.3.  [default: [arms] stands_at_m]",
    ),
]


FromOption = Annotated[From | None, typer.Option("--from", help="Start pose of a dry run.  [default: stow]")]


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


def home(
    config: VehicleConfigFile = None,
    port: PortOption = None,
    yes: YesOption = False,
    dry_run: DryRunOption = False,
    start: FromOption = None,
    plot: PlotOption = None,
    floor_z_m: FloorOption = None,
) -> None:
    """Move both arms to the pose they work from, claws closed."""
    bench = bench_of(config, port)
    floor = bench.floor(floor_z_m)
    wish = pose_wish("home", bench.arms, bench.arms.home_rad(), floor)
    carry_out(bench, wish, How(yes, dry_run, start, plot, floor))


def stow(
    config: VehicleConfigFile = None,
    port: PortOption = None,
    yes: YesOption = False,
    dry_run: DryRunOption = False,
    start: FromOption = None,
    plot: PlotOption = None,
    floor_z_m: FloorOption = None,
) -> None:
    """Fold both arms as for take-off and landing, claws closed."""
    bench = bench_of(config, port)
    floor = bench.floor(floor_z_m)
    wish = pose_wish("stow", bench.arms, bench.arms.stow_rad(), floor)
    carry_out(bench, wish, How(yes, dry_run, start, plot, floor))


def play(
    motion: Annotated[
        str,
        typer.Argument(
            help="swing, another name in config/arms/, or a TOML or CSV file of joint motion.",
            autocompletion=complete.motions,
        ),
    ],
    config: VehicleConfigFile = None,
    port: PortOption = None,
    duration: Annotated[
        float | None, typer.Option(min=0.1, max=3600.0, help="Duration of sinusoids, s.  [default: their file's]")
    ] = None,
    repeat: Annotated[int, typer.Option(min=1, max=100, help="Play the motion this many times.")] = 1,
    yes: YesOption = False,
    dry_run: DryRunOption = False,
    start: FromOption = None,
    plot: PlotOption = None,
    floor_z_m: FloorOption = None,
) -> None:
    """Play a motion; the arms move to its start first."""
    bench = bench_of(config, port)
    floor = bench.floor(floor_z_m)
    wish = play_wish(motion, bench.arms, duration, repeat, floor)
    carry_out(bench, wish, How(yes, dry_run, start, plot, floor))


def grip(
    claws: Annotated[Claws, typer.Argument(help="open or close")],
    config: VehicleConfigFile = None,
    port: PortOption = None,
    yes: YesOption = False,
    dry_run: DryRunOption = False,
    start: FromOption = None,
    plot: PlotOption = None,
) -> None:
    """Open or close both claws; nothing else moves."""
    bench = bench_of(config, port)
    poses = bench.arms.poses
    angle_rad = poses.claw_open_rad if claws is Claws.OPEN else poses.claw_closed_rad
    carry_out(bench, grip_wish(f"grip {claws}", bench.arms, angle_rad), How(yes, dry_run, start, plot, None))


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
