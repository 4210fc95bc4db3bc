"""Numbers and picture of several vehicles' flight, from their records."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from companion.analysis.summary import Summary, summarise
from companion.config.separation_config import SeparationConfig
from companion.core.types import Array
from companion.records.flight_record import FlightRecord
from companion.records.read import read_flight

_STEP_S = 0.01


@dataclass(frozen=True)
class VehicleReport:
    """One vehicle's flight."""

    name: str
    path: Path
    record: FlightRecord
    summary: Summary | None


@dataclass(frozen=True)
class Separated:
    """Horizontal distance of two vehicles over time, on the clock that all services of one computer share."""

    names: tuple[str, str]
    times_s: Array
    """(n,), monotonic."""
    distance_m: Array
    """(n,); infinite while neither flies, or the height difference is at least that of the cylinder."""

    @property
    def least_m(self) -> float:
        """Least distance; infinite when they never flew at one height."""
        return float(self.distance_m.min(initial=np.inf))


def read_reports(paths: dict[str, Path]) -> tuple[VehicleReport, ...]:
    """Read the records of all vehicles by their names; RecordError where one cannot be read."""
    reports = []
    for name, path in paths.items():
        record = read_flight(path)
        reports.append(VehicleReport(name, path, record, summarise(record.columns)))
    return tuple(reports)


def separations(reports: Sequence[VehicleReport], rules: SeparationConfig) -> tuple[Separated, ...]:
    """Return the distance of each pair."""
    return tuple(_separated(one, other, rules) for one, other in itertools.combinations(reports, 2))


def _separated(one: VehicleReport, other: VehicleReport, rules: SeparationConfig) -> Separated:
    first, second = _times_s(one), _times_s(other)
    times_s = np.arange(max(first[0], second[0]), min(first[-1], second[-1]), _STEP_S)
    apart = _positions_w_m(one, times_s) - _positions_w_m(other, times_s)
    flies = np.maximum(_airborne(one, times_s), _airborne(other, times_s)) > 0.0
    counts = flies & (np.abs(apart[:, 2]) < rules.height_m)
    distance_m = np.where(counts, np.hypot(apart[:, 0], apart[:, 1]), np.inf)
    return Separated((one.name, other.name), times_s, distance_m)


def _times_s(report: VehicleReport) -> Array:
    return np.asarray(report.record.columns["time_s"], dtype=float)


def _positions_w_m(report: VehicleReport, times_s: Array) -> Array:
    places = np.asarray(report.record.columns["position_w_m"], dtype=float)
    known = np.isfinite(places).all(axis=1)
    return np.stack([np.interp(times_s, _times_s(report)[known], axis) for axis in places[known].T], axis=-1)


def _airborne(report: VehicleReport, times_s: Array) -> Array:
    """Return 1 where it flies, 0 where it stands, and something between at takeoff and touchdown, (n,)."""
    airborne = np.asarray(report.record.columns["airborne"], dtype=float)
    return np.asarray(np.interp(times_s, _times_s(report), airborne))


def as_dict(reports: Sequence[VehicleReport], pairs: Sequence[Separated]) -> dict[str, Any]:
    """Return separation and records for --summary."""
    return {
        "least_separation_m": {" ".join(pair.names): pair.least_m for pair in pairs if np.isfinite(pair.least_m)},
        "records": {report.name: str(report.path) for report in reports},
    }


def plot_fleet(
    reports: Sequence[VehicleReport], pairs: Sequence[Separated], rules: SeparationConfig, path: Path
) -> None:
    """Write a picture: the ways from above, distances with the limit, height and tracking error over time."""
    from companion.cli.demo.fleet.picture import draw  # noqa: PLC0415 - matplotlib takes a second to import

    draw(reports, pairs, rules, path)
