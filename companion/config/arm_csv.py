"""Joint waypoints in CSV: `t_s,right.shoulder_pitch_deg,...`; each column says its joint and its unit."""

import math
from pathlib import Path

import numpy as np

from companion.arms.model import JOINT_NAMES
from companion.arms.motion_spec import Poses
from companion.config.csv_table import read_table
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.core.waypoint_limits import time_mistake

MAX_ROWS = 2000
LONGEST_S = 600.0
_WANTED = "t_s,right.shoulder_pitch_deg,... (or _rad)"
_UNITS = {"deg": math.pi / 180.0, "rad": 1.0}
_COLUMNS = {f"{joint}_{unit}": (place, unit) for place, joint in enumerate(JOINT_NAMES) for unit in _UNITS}


def read_csv(path: Path) -> Poses:
    """Read the waypoints, passed without stopping; a joint without a column stays. ConfigError names the line."""
    table = read_table(path, _WANTED)
    _check_header(table.header, path)
    if not 2 <= len(table.rows) <= MAX_ROWS:
        raise ConfigError(f"{path}: 2 to {MAX_ROWS} waypoints are needed, there are {len(table.rows)}")
    numbers = table.numbers()
    times_s = numbers[:, table.header.index("t_s")]
    wrong = time_mistake(times_s.tolist(), LONGEST_S)
    if wrong is not None:
        raise table.wrong(*wrong)
    return Poses(times_s, _joints(table.header, numbers), stop=False)


def _joints(header: tuple[str, ...], table: Array) -> Array:
    """Return the joints of each row, (n, 8), rad; NaN without a column."""
    out = np.full((len(table), len(JOINT_NAMES)), math.nan)
    for column, name in enumerate(header):
        if name in _COLUMNS:
            place, unit = _COLUMNS[name]
            out[:, place] = table[:, column] * _UNITS[unit]
    return out


def _check_header(header: tuple[str, ...], path: Path) -> None:
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
