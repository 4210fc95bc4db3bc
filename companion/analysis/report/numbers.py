"""The numbers of a flight: errors, triggers, latencies. Pure."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from companion.analysis.report.link_numbers import LinkNumbers, link_numbers, side_of
from companion.analysis.report.recorded_flight import Flown, Mask, Trajectory
from companion.analysis.report.separation import SeparationNumbers, separation_numbers
from companion.analysis.report.story import Story, story_of
from companion.core.types import Array

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Errors:
    """Statistics of the absolute errors over some cycles, m, in W: per axis and of the norm."""

    cycles: int
    mean_m: tuple[float, ...]
    rms_m: tuple[float, ...]
    max_m: tuple[float, ...]
    """x, y, z and the norm."""


@dataclass(frozen=True)
class Triggers:
    """Triggers and updates over some cycles, and the times between triggers, s."""

    cycles: int
    event_share: float
    sent_share: float
    events: int
    gap_median_s: float
    gap_max_s: float


@dataclass(frozen=True)
class TrajectoryNumbers:
    """One trajectory of a flight."""

    name: str
    law: str
    begin_s: float
    """Time since lift-off."""
    duration_s: float
    errors: Errors | None
    triggers: Triggers | None


@dataclass(frozen=True)
class Spread:
    """Distribution of a latency, s."""

    count: int
    median_s: float
    p95_s: float
    max_s: float


@dataclass(frozen=True)
class HorizonNumbers:
    """Error of the autopilot's horizon against motion capture while the law flew: norm of its slow part, rad."""

    rms_rad: float
    max_rad: float
    corrected_rms_rad: float
    """RMS of the correction; 0 where it was switched off."""


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """All numbers of a flight; those without data are None."""

    flight: str
    started_unix_s: float | None
    vehicle: str
    side: str
    """Side of the link that recorded it, and its session; empty for a law on board."""
    laws: tuple[str, ...]
    versions: dict[str, str]
    off: str
    """Sentence that says which checks were off; empty where none was."""
    ended: str
    over: bool
    """True if the flight ended within the record."""
    truncated: bool
    damage: str
    """Description of what could not be read."""
    dropped: int
    duration_s: float
    """Time in the air."""
    law_s: float
    """Part of it with the control law in charge."""
    trajectories: tuple[TrajectoryNumbers, ...]
    tracked: Errors | None
    """Errors on all trajectories."""
    whole: Errors | None
    triggers_whole: Triggers | None
    latencies: dict[str, Spread]
    horizon: HorizonNumbers | None
    link: tuple[LinkNumbers, ...]
    """Traffic of the link on each trajectory, and last in the air; empty for a law on board."""
    others: tuple[SeparationNumbers, ...]
    """Nearest approach of each other vehicle; empty in a room of one vehicle."""
    story: Story

    def as_dict(self) -> dict[str, Any]:
        """Return the numbers for JSON, without NaN or infinity."""
        plain: dict[str, Any] = _plain(asdict(self))
        return plain


def numbers_of(flown: Flown) -> Numbers:
    """Return the numbers of a record."""
    record, story = flown.record, story_of(flown)
    unix_s = record.unix_offset_s + float(flown.column("time_s")[0]) if record.unix_offset_s else None
    return Numbers(
        flight=flown.name,
        started_unix_s=unix_s,
        vehicle=str(record.metadata.get("vehicle", "")),
        side=side_of(flown),
        laws=flown.law_names,
        versions={str(name): str(version) for name, version in record.metadata.get("versions", {}).items()},
        off=str(record.metadata.get("off", "")),
        ended=story.ended,
        over=story.over,
        truncated=record.truncated,
        damage=record.damage,
        dropped=record.dropped,
        duration_s=_span_s(flown.time_s[flown.in_the_air]),
        law_s=_span_s(flown.time_s[flown.airborne]),
        trajectories=tuple(_trajectory(flown, one) for one in flown.trajectories),
        tracked=_errors(flown, flown.tracked),
        whole=_errors(flown, flown.airborne),
        triggers_whole=_triggers(flown, flown.airborne),
        latencies={name: _spread(seconds) for name, seconds in flown.latencies_s().items()},
        horizon=_horizon(flown) if record.frames else None,
        link=link_numbers(flown),
        others=separation_numbers(flown),
        story=story,
    )


def _span_s(time_s: Array) -> float:
    return float(time_s[-1] - time_s[0]) if time_s.size else 0.0


def _trajectory(flown: Flown, one: Trajectory) -> TrajectoryNumbers:
    return TrajectoryNumbers(
        one.name,
        one.law,
        one.begin_s,
        one.end_s - one.begin_s,
        _errors(flown, one.mask),
        _triggers(flown, one.mask),
    )


def _errors(flown: Flown, among: Mask) -> Errors | None:
    known = among & np.isfinite(flown.distance_m)
    if not known.any():
        return None
    errors = np.abs(np.column_stack((flown.error_w_m[known], flown.distance_m[known])))
    mean, most = errors.mean(axis=0), errors.max(axis=0)
    rms = np.sqrt((errors**2).mean(axis=0))
    return Errors(int(known.sum()), *(tuple(values.tolist()) for values in (mean, rms, most)))


def _triggers(flown: Flown, among: Mask) -> Triggers | None:
    if not among.any() or not flown.has("event"):
        return None
    _, gaps_s = flown.gaps_s(among)
    median_s, max_s = (float(np.median(gaps_s)), float(gaps_s.max())) if gaps_s.size else (np.nan, np.nan)
    event, sent = flown.event[among], flown.sent[among]
    return Triggers(int(among.sum()), float(event.mean()), float(sent.mean()), int(event.sum()), median_s, max_s)


def _horizon(flown: Flown) -> HorizonNumbers | None:
    off = np.column_stack([flown.column(f"horizon_off_{axis}_rad") for axis in ("roll", "pitch")])[flown.airborne]
    used = np.column_stack([flown.column(f"horizon_{axis}_rad") for axis in ("roll", "pitch")])[flown.airborne]
    squares = (off**2).sum(axis=1)
    known = np.isfinite(squares)
    if not known.any():
        return None
    rms_rad, max_rad = np.sqrt(squares[known].mean()), np.sqrt(squares[known].max())
    return HorizonNumbers(float(rms_rad), float(max_rad), float(np.sqrt((used[known] ** 2).sum(axis=1).mean())))


def _spread(seconds: Array) -> Spread:
    median_s, p95_s = np.percentile(seconds, [50.0, 95.0]).tolist()
    return Spread(len(seconds), median_s, p95_s, float(seconds.max()))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
