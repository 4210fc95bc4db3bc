"""Motions of the arms on the bench: planning from the present pose, and the preview."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from companion.arms.model import JOINT_NAMES, ArmModel
from companion.arms.motion_spec import Swing
from companion.arms.planning import Plan, grip, plan, to_pose
from companion.arms.trajectory import InTurn
from companion.cli.arms.table import narrow_table
from companion.config.arm_files import motion_named
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.studies.paper.arm_motion import MotionNumbers, numbers_of

_PLAN_COLUMNS = ("joint", "from", "to", "lowest", "highest", "largest\nrad/s", "largest\nrad/s^2")


@dataclass(frozen=True)
class Wish:
    """Requested motion of the arms: its name and its planner."""

    name: str
    """Command and motion, such as "play swing"."""
    plan_from: Callable[[Array], Plan]
    """Plans the motion from a pose (8,) at rest; ArmError with the reason when there is none."""


def pose_wish(name: str, arms: ArmsConfig, goal_rad: Array, floor_z_m: float | None) -> Wish:
    """Return a motion to a pose, through the home pose when the direct way is blocked."""
    model, home = arms.model(), arms.home_rad()
    return Wish(name, lambda start: to_pose(model, start, goal_rad, (home,), floor_z_m))


def grip_wish(name: str, arms: ArmsConfig, claw_rad: float) -> Wish:
    """Return a motion of both claws to an angle; no other joint moves."""
    model = arms.model()
    return Wish(name, lambda start: grip(model, start, claw_rad))


def play_wish(file: str, arms: ArmsConfig, duration_s: float | None, times: int, floor_z_m: float | None) -> Wish:
    """Return a file's or config/arms/ name's motion, played `times` times; ConfigError for an unusable file."""
    described = motion_named(file, duration_s)
    if duration_s is not None and not isinstance(described, Swing):
        raise ConfigError(f"--duration is for sinusoids: {file} is a motion through poses and takes what its file says")
    model, via = arms.model(), (arms.home_rad(),)

    def plan_from(start: Array) -> Plan:
        motion = described.trajectory(model, start)
        first = plan(model, motion, start, via, floor_z_m)
        if times == 1:
            return first
        end_rad = np.asarray(first.trajectory.at(first.trajectory.duration_s).position_rad)
        again = plan(model, motion, end_rad, via, floor_z_m)
        way_s = again.approach_s
        note = f"played {times} times" + (f", with {way_s:.1f} s back to its start each time" if way_s else "")
        whole = InTurn((first.trajectory, *[again.trajectory] * (times - 1)))
        return replace(first, trajectory=whole, notes=(*first.notes, note))

    return Wish(f"play {file}", plan_from)


def preview(console: Console, wish: Wish, planned: Plan, model: ArmModel, floor_z_m: float | None) -> MotionNumbers:
    """Print the plan's limits and clearance; return its numbers."""
    numbers = numbers_of(model, planned.trajectory, floor_z_m)
    console.print(f"[bold]{escape(wish.name)}[/]: {numbers.duration_s:.1f} s", highlight=False, soft_wrap=True)
    for note in planned.notes:
        console.print(f"  {note}", highlight=False, soft_wrap=True, markup=False)
    console.print(_limits_table(model, numbers))
    near = numbers.nearest
    console.print(
        f"least clearance {near.distance_m:.3f} m, {near.time_s:.1f} s into it: {near.what} "
        f"({model.margin_m:.3f} m is required)",
        highlight=False,
        soft_wrap=True,
    )
    return numbers


def _limits_table(model: ArmModel, numbers: MotionNumbers) -> Table:
    low, high, speed, accel = model.limit_arrays()
    angles = numbers.motion.position_rad
    table = narrow_table(_PLAN_COLUMNS, "angles in degrees; in brackets what is allowed")
    for place, name in enumerate(JOINT_NAMES):
        column = angles[:, place]
        table.add_row(
            name,
            *(f"{math.degrees(angle):+.1f}" for angle in (column[0], column[-1])),
            f"{math.degrees(column.min()):+.1f} ({math.degrees(low[place]):+.0f})",
            f"{math.degrees(column.max()):+.1f} ({math.degrees(high[place]):+.0f})",
            f"{numbers.fastest_radps[place]:.2f} ({speed[place]:g})",
            f"{numbers.sharpest_radps2[place]:.1f} ({accel[place]:g})",
        )
    return table


def draw(path: Path, wish: Wish, planned: Plan, model: ArmModel, numbers: MotionNumbers) -> None:
    """Draw the plan into a PNG file; ConfigError when it cannot be written."""
    from companion.studies.paper.arm_motion_plot import plot_motion  # noqa: PLC0415 - matplotlib takes a second to import

    try:
        plot_motion(model, numbers, planned.approach_s, wish.name, path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--plot {path}: cannot be written: {error}") from error
