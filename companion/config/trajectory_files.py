"""Values of `--trajectory`: the paper's two curves by name, or waypoints in a CSV file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.config.csv_table import CsvTable, read_table, wrong_header
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.core.waypoint_limits import LONGEST_S, MAX_WAYPOINTS, MAX_YAW_RAD, time_mistake
from companion.trajectories.reference import Ellipse, FigureEight, LapTiming, Trajectory
from companion.trajectories.waypoints import Waypoints

NAMES = ("ellipse", "figure8")
_COLUMNS = ["t_s", "x_m", "y_m", "z_m"]
_YAW = "yaw_rad"
_DECIMALS = 6
_WANTED = f"{','.join(_COLUMNS)} or {','.join([*_COLUMNS, _YAW])}"


@dataclass(frozen=True)
class Curve:
    """Parameters of a named curve; the sizes resemble the paper's, about 1 m."""

    laps: int = 2
    period_s: float = 15.0
    size: float = 1.0
    height_m: float = 1.2


def trajectory_named(name: str, curve: Curve) -> Trajectory:
    """Return the trajectory of a name or a CSV file; ConfigError for an unknown name or a bad file."""
    timing = LapTiming(curve.period_s, curve.laps)
    centre = np.array([0.0, 0.0, curve.height_m])
    if name == "ellipse":
        return Ellipse(centre, (1.0 * curve.size, 0.6 * curve.size), timing)
    if name == "figure8":
        return FigureEight(centre, (1.0 * curve.size, 0.5 * curve.size), timing)
    path = Path(name)
    if path.suffix.lower() != ".csv" and not path.exists():
        raise ConfigError(f"unknown trajectory {name!r}: give {' or '.join(NAMES)}, or a CSV file of waypoints")
    return read_waypoints(path)


def read_waypoints(path: Path) -> Waypoints:
    """Read a CSV file with columns t_s, x_m, y_m, z_m, perhaps yaw_rad, in W; ConfigError naming the line."""
    table = read_table(path, _WANTED)
    if sorted(table.header) not in (sorted(_COLUMNS), sorted([*_COLUMNS, _YAW])):
        raise wrong_header(table, _WANTED)
    count = len(table.rows)
    if count < 2:
        raise ConfigError(f"{path}: at least two waypoints are needed, there are {count}")
    if count > MAX_WAYPOINTS:
        raise ConfigError(f"{path}: at most {MAX_WAYPOINTS} waypoints, there are {count}: thin them out")
    numbers = table.numbers()
    column = {name: numbers[:, place] for place, name in enumerate(table.header)}
    wrong = time_mistake(column["t_s"].tolist(), LONGEST_S)
    if wrong is not None:
        raise table.wrong(*wrong)
    yaws_rad = column.get(_YAW, np.zeros(count))
    _check_headings(yaws_rad, table)
    return Waypoints(column["t_s"], np.stack([column[name] for name in _COLUMNS[1:]], axis=-1), yaws_rad)


def rows_of(waypoints: Waypoints) -> list[dict[str, float]]:
    """Return waypoints as rows of the bus's `track` command."""
    return rows_of_table(np.column_stack((waypoints.times_s, waypoints.positions_w_m, waypoints.yaws_rad)))


def rows_of_table(table: Array) -> list[dict[str, float]]:
    """Return a table (N, 4) or (N, 5) as rows of the bus's `track` command; rounded, so that 400 fit into it."""
    names = (*_COLUMNS, _YAW)[: table.shape[1]]
    return [dict(zip(names, row, strict=True)) for row in table.round(_DECIMALS).tolist()]


def _check_headings(yaws_rad: Array, table: CsvTable) -> None:
    large = np.flatnonzero(np.abs(yaws_rad) > MAX_YAW_RAD)
    if large.size:
        row = int(large[0])
        what = (
            f"yaw_rad = {yaws_rad[row]:g} is more than a whole turn (6.28): is it in degrees? Give radians from "
            "-3.1416 to 3.1416; the vehicle turns the short way from one waypoint to the next"
        )
        raise table.wrong(row, what)
