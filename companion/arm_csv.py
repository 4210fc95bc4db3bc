"""Joint waypoints in CSV: `t_s,right.shoulder_pitch_deg,...`; each column says its joint and its unit."""

import csv
import math
from pathlib import Path

import numpy as np

from companion.arms.described import Poses
from companion.arms.model import JOINT_NAMES
from companion.csv_rows import numbers_of
from companion.ports import ConfigError
from companion.types import Array

MAX_ROWS = 2000
LEAST_GAP_S = 0.01
"""Between two waypoints."""
LONGEST_S = 600.0
_UNITS = {"deg": math.pi / 180.0, "rad": 1.0}
_COLUMNS = {f"{joint}_{unit}": (place, unit) for place, joint in enumerate(JOINT_NAMES) for unit in _UNITS}


def read_csv(path: Path) -> Poses:
    """The waypoints, passed without stopping; a joint without a column stays. ConfigError names the line."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [(reader.line_num, row) for reader in [csv.reader(file)] for row in reader if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: cannot be read as CSV: {error}") from error
    if not lines:
        raise ConfigError(f"{path}: is empty; the first line must be t_s,right.shoulder_pitch_deg,... (or _rad)")
    header, rows = [cell.strip() for cell in lines[0][1]], lines[1:]
    _check_header(header, path)
    if not 2 <= len(rows) <= MAX_ROWS:
        raise ConfigError(f"{path}: 2 to {MAX_ROWS} waypoints are needed, there are {len(rows)}")
    table = np.array([numbers_of(row, len(header), line, path) for line, row in rows])
    times_s = table[:, header.index("t_s")]
    _check_times(times_s, [line for line, _ in rows], path)
    return Poses(times_s, _joints(header, table), stop=False)


def _joints(header: list[str], table: Array) -> Array:
    """(n, 8), rad; NaN without a column."""
    out = np.full((len(table), len(JOINT_NAMES)), math.nan)
    for column, name in enumerate(header):
        if name in _COLUMNS:
            place, unit = _COLUMNS[name]
            out[:, place] = table[:, column] * _UNITS[unit]
    return out


def _check_header(header: list[str], path: Path) -> None:
    if "t_s" not in header or len(header) < 2:
        raise ConfigError(f"{path}: the first line must name t_s and at least one joint, as right.shoulder_pitch_deg")
    seen: set[str] = set()
    for name in header:
        joint = name.rpartition("_")[0] if name in _COLUMNS else name
        if name in JOINT_NAMES:
            raise ConfigError(f"{path}: column {name!r} must say its unit: {name}_deg or {name}_rad")
        if name != "t_s" and name not in _COLUMNS:
            raise ConfigError(
                f"{path}: unknown column {name!r}; known are t_s and, followed by _deg or _rad, "
                f"{', '.join(JOINT_NAMES)}"
            )
        if joint in seen:
            raise ConfigError(f"{path}: {joint} has two columns")
        seen.add(joint)


def _check_times(times_s: Array, lines: list[int], path: Path) -> None:
    if times_s[0] != 0.0:
        raise ConfigError(f"{path}: line {lines[0]}: t_s must begin at 0, not {times_s[0]:g}")
    if times_s[-1] > LONGEST_S:
        raise ConfigError(f"{path}: line {lines[-1]}: t_s must be at most {LONGEST_S:g}, not {times_s[-1]:g}")
    short = np.flatnonzero(np.diff(times_s) < LEAST_GAP_S - 1e-9)
    if short.size:
        row = int(short[0])
        raise ConfigError(
            f"{path}: line {lines[row + 1]}: t_s must rise by at least {LEAST_GAP_S:g} s, "
            f"{times_s[row + 1]:g} does not follow {times_s[row]:g}"
        )
