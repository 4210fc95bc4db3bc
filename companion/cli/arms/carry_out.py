"""One motion on the bench from the command line: look, plan, show, ask, move."""

import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import typer
from rich.console import Console

from companion.cli.arms.bench import Bench, open_bus, run
from companion.cli.arms.motion import move_arms
from companion.cli.arms.plan import Wish, draw, preview
from companion.cli.arms.table import torque_words
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.core.interfaces import ConfigError
from companion.core.types import ArmStatus, Array

_UNMOVED = "interrupted: nothing was moved"


class From(StrEnum):
    """Start pose of a dry run."""

    STOW = "stow"
    HOME = "home"


@dataclass(frozen=True)
class How:
    """Options that all moving commands share."""

    yes: bool
    dry_run: bool
    start: From | None
    plot: Path | None
    floor_z_m: float | None


def carry_out(bench: Bench, wish: Wish, how: How) -> None:
    """Read the joints, plan, show the plan, ask, move; a dry run only plans and shows."""
    console = Console()
    if how.dry_run:
        start_rad = bench.arms.home_rad() if how.start is From.HOME else bench.arms.stow_rad()
        _show(console, bench, wish, start_rad, how)
        return
    if how.start is not None:
        raise ConfigError("--from is for --dry-run: a real motion begins where the arms are")
    if not how.yes and not sys.stdin.isatty():
        raise ConfigError(f"{wish.name} moves the arms, and there is no terminal to ask at: add --yes")
    status = run(_look(bench), _UNMOVED)
    _show(console, bench, wish, status.position_rad, how)
    limp = "" if status.torque_on.all() else "; it is switched on where the arms are, without a jump"
    console.print(f"{torque_words(status)}{limp}; at the end the arms hold", highlight=False, soft_wrap=True)
    if not how.yes and not _agreed():
        console.print("nothing was moved")
        raise typer.Exit(FAILED)
    ended = run(move_arms(bench, wish, status.position_rad, console), _UNMOVED)
    typer.echo(ended.text if ended.code == 0 else f"companion: {ended.text}", err=ended.code != 0)
    raise typer.Exit(ended.code)


def _show(console: Console, bench: Bench, wish: Wish, start_rad: Array, how: How) -> None:
    try:
        _plan_and_show(console, bench, wish, start_rad, how)
    except KeyboardInterrupt:
        typer.echo(_UNMOVED, err=True)
        raise typer.Exit(INTERRUPTED) from None


def _plan_and_show(console: Console, bench: Bench, wish: Wish, start_rad: Array, how: How) -> None:
    model, planned = bench.arms.model(), wish.plan_from(start_rad)
    numbers = preview(console, wish, planned, model, how.floor_z_m)
    if how.plot is not None:
        draw(how.plot, wish, planned, model, numbers)
        console.print(f"plot {how.plot}", markup=False, highlight=False, soft_wrap=True)


async def _look(bench: Bench) -> ArmStatus:
    async with open_bus(bench.arms) as bus:
        return bus.status()


def _agreed() -> bool:
    try:
        return typer.confirm("move?", default=False)
    except typer.Abort:
        typer.echo(f"\n{_UNMOVED}", err=True)
        raise typer.Exit(INTERRUPTED) from None
