"""Motions of the arms in files: which file a name means, and TOML into a description. CSV is in `arm_csv`."""

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from companion.arms.model import CHAIN, JOINTS_PER_ARM
from companion.arms.motion_spec import Described, Poses, Swing, Tips
from companion.config.arm_csv import LONGEST_S, MAX_ROWS, read_csv
from companion.config.locations import default_config_path, names_in
from companion.config.toml_files import Section, read_toml, validate
from companion.core.interfaces import ConfigError
from companion.core.types import Array
from companion.core.waypoint_limits import LEAST_GAP_S

_Unit = Literal["deg", "rad"]
_KIND = "kind of the motion"
_STOP = "rest at each point; false: pass it smoothly"


def motion_named(name: str, duration_s: float | None = None) -> Described:
    """Return the motion of a .toml or .csv file, or of a name in config/arms/; `duration_s` (s) is for sinusoids.

    A motion through poses takes as long as its file says. Raises ConfigError, one sentence a mistake.
    """
    path = _path(name)
    return read_csv(path) if path.suffix.lower() == ".csv" else _read_toml(path, duration_s)


def _path(name: str) -> Path:
    path = Path(name)
    if path.suffix.lower() in {".toml", ".csv"}:
        return path
    known = names_in("arms")
    if name in known:
        return default_config_path("arms") / f"{name}.toml"
    raise ConfigError(f"unknown arm motion {name!r}: give {', '.join(known)}, or a file that ends in .toml or .csv")


def _three_or_four(angles: list[float]) -> list[float]:
    if len(angles) not in {CHAIN, JOINTS_PER_ARM}:
        raise ValueError("must be three angles (shoulder pitch, elbow pitch, elbow roll) or four (the claw)")
    return angles


def _three(point: list[float]) -> list[float]:
    if len(point) != 3:
        raise ValueError("must be three coordinates (x forward, y left, z up)")
    return point


_Angles = Annotated[list[float], AfterValidator(_three_or_four)]
_Point = Annotated[list[float], AfterValidator(_three)]


class _Timed(Section):
    """A point at its time."""

    t_s: float = Field(ge=0.0, le=LONGEST_S, description="time from the motion's begin, s")


class _Pose(_Timed):
    """Angles of both arms at a time; an arm that is left out stays where it was."""

    right: _Angles | None = Field(None, description="shoulder pitch, elbow pitch, elbow roll, and perhaps the claw")
    left: _Angles | None = Field(None, description="the same of the left arm")


class _Tip(_Timed):
    """Places of both tips at a time; an arm that is left out stays where it was."""

    right: _Point | None = Field(None, description="x, y, z of the right tip in body FLU, m")
    left: _Point | None = Field(None, description="x, y, z of the left tip in body FLU, m")


def _check_times(points: Sequence[_Timed], table: str) -> None:
    if not 2 <= len(points) <= MAX_ROWS:
        raise ValueError(f"{table}: 2 to {MAX_ROWS} are needed, there are {len(points)}")
    if points[0].t_s != 0.0:
        raise ValueError(f"{table}.0.t_s = {points[0].t_s:g}: must be 0")
    for number, (before, after) in enumerate(pairwise(point.t_s for point in points), start=1):
        if after < before + LEAST_GAP_S - 1e-9:
            raise ValueError(f"{table}.{number}.t_s = {after:g}: must be at least {LEAST_GAP_S:g} s after {before:g}")


class _Waypoints(Section):
    """A motion through poses."""

    kind: Literal["waypoints"] = Field(description=_KIND)
    unit: _Unit = Field(description="unit of all angles in the file")
    stop: bool = Field(True, description=_STOP)
    waypoints: list[_Pose] = Field(description="two tables or more, in the order of their times")

    @model_validator(mode="after")
    def _times(self) -> "_Waypoints":
        _check_times(self.waypoints, "waypoints")
        return self

    def described(self) -> Poses:
        rows = [np.concatenate([_joints(pose.right), _joints(pose.left)]) for pose in self.waypoints]
        return Poses(np.array([pose.t_s for pose in self.waypoints]), _rad(np.stack(rows), self.unit), self.stop)


class _Swinging(Section):
    """Swing of one arm; one that is left out stays where it was."""

    centre: _Angles = Field(description="angles about which the joints swing, three or with the claw four")
    amplitude: _Angles = Field(description="largest angles from the centre")
    phase: _Angles = Field([0.0, 0.0, 0.0], description="phases at the begin")
    period_s: float = Field(ge=0.2, le=120.0, description="time of one swing, s")


class _Sinusoid(Section):
    """A swing of the joints."""

    kind: Literal["sinusoid"] = Field(description=_KIND)
    unit: _Unit = Field(description="unit of all angles in the file")
    duration_s: float = Field(gt=0.0, le=LONGEST_S, description="time of the motion where nothing else ends it, s")
    fade_s: float = Field(2.0, ge=0.1, le=60.0, description="time in which the swing grows, and fades at its end, s")
    right: _Swinging | None = None
    left: _Swinging | None = None

    @model_validator(mode="after")
    def _some_arm(self) -> "_Sinusoid":
        if self.right is None and self.left is None:
            raise ValueError("a sinusoid needs a table [right] or [left], or both")
        return self

    def described(self, duration_s: float | None) -> Swing:
        arms = (self.right, self.left)
        centre, amplitude, phase = (
            _rad(np.concatenate([_joints(getattr(arm, name) if arm else None) for arm in arms]), self.unit)
            for name in ("centre", "amplitude", "phase")
        )
        return Swing(
            centre_rad=centre,
            amplitude_rad=np.nan_to_num(amplitude),
            period_s=np.repeat([arm.period_s if arm else LONGEST_S for arm in arms], JOINTS_PER_ARM),
            phase_rad=np.nan_to_num(phase),
            duration_s=self.duration_s if duration_s is None else duration_s,
            fade_s=self.fade_s,
        )


class _Tips(Section):
    """A motion through places of the tips."""

    kind: Literal["tips"] = Field(description=_KIND)
    unit: Literal["m"] = Field(description="unit of all places in the file")
    stop: bool = Field(True, description=_STOP)
    tips: list[_Tip] = Field(description="two tables or more, in the order of their times")

    @model_validator(mode="after")
    def _times(self) -> "_Tips":
        _check_times(self.tips, "tips")
        return self

    def described(self) -> Tips:
        stays = [math.nan] * 3
        points = np.array([[point.right or stays, point.left or stays] for point in self.tips])
        return Tips(np.array([point.t_s for point in self.tips]), points, self.stop)


MOTIONS = {"waypoints": _Waypoints, "sinusoid": _Sinusoid, "tips": _Tips}
"""The kinds of motions, for the page that lists their keys."""


def _read_toml(path: Path, duration_s: float | None) -> Described:
    data: dict[str, Any] = read_toml(path)
    match data.get("kind"):
        case "waypoints":
            return validate(_Waypoints, data, path).described()
        case "sinusoid":
            return validate(_Sinusoid, data, path).described(duration_s)
        case "tips":
            return validate(_Tips, data, path).described()
        case None:
            raise ConfigError(f"{path}: kind: is missing; give waypoints, sinusoid or tips")
        case other:
            raise ConfigError(f"{path}: kind = {other!r}: must be waypoints, sinusoid or tips")


def _joints(angles: _Angles | None) -> Array:
    """Return one arm's joints (4,), NaN where the file has none."""
    given = angles or []
    return np.array([*given, *[math.nan] * (JOINTS_PER_ARM - len(given))])


def _rad(angles: Array, unit: _Unit) -> Array:
    return np.asarray(np.radians(angles) if unit == "deg" else angles)
