"""What `--trajectory` means: the paper's two curves by name, or waypoints in a CSV file."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.control.reference import Ellipse, FigureEight, LapTiming, Trajectory
from companion.control.waypoints import Waypoints
from companion.ports import ConfigError

NAMES = ("ellipse", "figure8")
_COLUMNS = ["t_s", "x_m", "y_m", "z_m"]


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
            reader = csv.DictReader(file)
            found, rows = list(reader.fieldnames or []), list(reader)
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: there is no such file") from error
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: cannot be read as CSV: {error}") from error
    if any(column not in found for column in _COLUMNS):
        raise ConfigError(f"{path}: the first line must name the columns {', '.join(_COLUMNS)} (and yaw_rad if wanted)")
    table = np.array([_numbers(row, line, path) for line, row in enumerate(rows, start=2)])
    if len(table) < 2 or table[0, 0] != 0.0 or np.any(np.diff(table[:, 0]) <= 0.0):
        raise ConfigError(f"{path}: t_s must begin at 0 and rise, with at least two waypoints")
    return Waypoints(table[:, 0], table[:, 1:4], table[:, 4])


def _numbers(row: dict[str, str], line: int, path: Path) -> list[float]:
    try:
        values = [float(row[column]) for column in _COLUMNS] + [float(row.get("yaw_rad") or 0.0)]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: line {line}: not a number in {row!r}") from error
    if not all(math.isfinite(value) for value in values):
        raise ConfigError(f"{path}: line {line}: every value must be finite, not {row!r}")
    return values
