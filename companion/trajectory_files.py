"""What `--trajectory` means: the paper's two curves by name, or waypoints in a CSV file."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.control.reference import Ellipse, FigureEight, LapTiming, Trajectory
from companion.control.waypoints import Waypoints
from companion.csv_rows import numbers_of
from companion.ports import ConfigError
from companion.types import Array
from companion.waypoint_limits import MAX_WAYPOINTS, MAX_YAW_RAD, time_mistake

NAMES = ("ellipse", "figure8")
_COLUMNS = ["t_s", "x_m", "y_m", "z_m"]
_YAW = "yaw_rad"


@dataclass(frozen=True)
class Curve:
    """How a named curve is flown; the sizes are those of the paper's look, about 1 m."""

    laps: int = 2
    period_s: float = 15.0
    size: float = 1.0
    height_m: float = 1.2


def trajectory_named(name: str, curve: Curve) -> Trajectory:
    """The trajectory of a name or a CSV file.

    Raises ConfigError for an unknown name, a missing file, or waypoints that cannot be flown.
    """
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
    """A CSV file with columns t_s, x_m, y_m, z_m and perhaps yaw_rad, in W; times rise from 0.

    Raises ConfigError naming the line.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            found, *rows = [[cell.strip() for cell in row] for row in csv.reader(file) if row] or [[]]
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: there is no such file") from error
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: cannot be read as CSV: {error}") from error
    if sorted(found) not in (sorted(_COLUMNS), sorted([*_COLUMNS, _YAW])):
        raise ConfigError(f"{path}: the first line must be {','.join(_COLUMNS)} or {','.join([*_COLUMNS, _YAW])}")
    if len(rows) < 2:
        raise ConfigError(f"{path}: at least two waypoints are needed, there are {len(rows)}")
    if len(rows) > MAX_WAYPOINTS:
        raise ConfigError(f"{path}: at most {MAX_WAYPOINTS} waypoints, there are {len(rows)}: thin them out")
    table = np.array([numbers_of(row, len(found), line, path) for line, row in enumerate(rows, start=2)])
    column = {name: table[:, place] for place, name in enumerate(found)}
    _check_times(column["t_s"], path)
    positions = np.stack([column[name] for name in _COLUMNS[1:]], axis=-1)
    yaws_rad = column.get(_YAW, np.zeros(len(table)))
    _check_headings(yaws_rad, path)
    return Waypoints(column["t_s"], positions, yaws_rad)


def _check_times(times_s: Array, path: Path) -> None:
    wrong = time_mistake(times_s.tolist())
    if wrong is not None:
        raise ConfigError(f"{path}: line {wrong[0] + 2}: {wrong[1]}")


def _check_headings(yaws_rad: Array, path: Path) -> None:
    large = np.flatnonzero(np.abs(yaws_rad) > MAX_YAW_RAD)
    if large.size:
        row = int(large[0])
        raise ConfigError(
            f"{path}: line {row + 2}: yaw_rad = {yaws_rad[row]:g} is more than a whole turn (6.28): is it in degrees? "
            "Give radians from -3.1416 to 3.1416; the vehicle turns the short way from one waypoint to the next"
        )
