"""Paths that a script may have flown: a curve of the paper, a CSV file, or waypoints as an array."""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from companion.core.errors import ConfigError
from companion.core.waypoint_limits import LONGEST_S, MAX_WAYPOINTS, time_mistake

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    Vector: TypeAlias = "Sequence[float] | NDArray[np.float64]"
    """Three numbers in W, m."""
    Waypoints: TypeAlias = "Sequence[Sequence[float]] | NDArray[np.float64]"
    """Rows of t_s, x_m, y_m, z_m in W, and perhaps yaw_rad: (N, 4) or (N, 5)."""

CurveName = Literal["ellipse", "figure8"]
CURVES: tuple[str, ...] = get_args(CurveName)
_WANTED = "rows of t_s, x_m, y_m, z_m, and perhaps yaw_rad: an array (N, 4) or (N, 5)"


@dataclass(frozen=True)
class Curve:
    """Curve of the paper: an ellipse or a figure-eight."""

    curve: CurveName = "ellipse"
    laps: int = 2
    period_s: float = 15.0
    """Duration of a lap."""
    size: float = 1.0
    """1 is 2 m across."""
    height_m: float | None = None
    """Height in W; None: the present one."""


def fields_of_path(path: "Curve | str | os.PathLike[str] | Waypoints") -> dict[str, Any]:
    """Return a path as fields of the command `track`; ConfigError with one sentence where it is none."""
    if isinstance(path, Curve):
        return asdict(path)
    if isinstance(path, str) and path in CURVES:
        return {"curve": path}
    return {"waypoints": _rows_of_file(path) if isinstance(path, str | os.PathLike) else _rows_of_array(path)}


def fields_of_position(position_w_m: "Vector") -> dict[str, float]:
    """Return a position as fields of the command `goto`; ConfigError where it is not three numbers."""
    try:
        x_m, y_m, z_m = (float(value) for value in position_w_m)
    except (TypeError, ValueError):
        raise ConfigError(f"goto: the position must be three numbers x, y, z in m, not {position_w_m!r}") from None
    return {"x_m": x_m, "y_m": y_m, "z_m": z_m}


def _rows_of_file(name: str | os.PathLike[str]) -> list[dict[str, float]]:
    from companion.config import trajectory_files  # noqa: PLC0415 - numpy takes time

    path = Path(name)
    if not path.exists():
        trajectory_files.trajectory_named(str(path), trajectory_files.Curve())  # raises with the names that exist
    return trajectory_files.rows_of(trajectory_files.read_waypoints(path))


def _rows_of_array(path: "Waypoints") -> list[dict[str, float]]:
    import numpy as np  # noqa: PLC0415 - as above

    from companion.config.trajectory_files import rows_of_table  # noqa: PLC0415

    try:
        table = np.asarray(path, dtype=float)
    except (TypeError, ValueError):
        raise ConfigError(f"track: give {_WANTED}") from None
    if table.ndim != 2 or table.shape[1] not in {4, 5}:
        raise ConfigError(f"track: give {_WANTED}, not one of shape {table.shape}")
    if not 2 <= len(table) <= MAX_WAYPOINTS:
        raise ConfigError(f"track: give 2 to {MAX_WAYPOINTS} waypoints, not {len(table)}")
    wrong = time_mistake(table[:, 0].tolist(), LONGEST_S) if np.isfinite(table).all() else None
    if wrong is not None:
        raise ConfigError(f"track: waypoint {wrong[0]}: {wrong[1]}")
    return rows_of_table(table)
