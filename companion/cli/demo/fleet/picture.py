"""Picture of several vehicles' flight: ways from above, and distance, height and error over time."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.analysis.report.charts import COLOURS, Medium, style_of
from companion.analysis.summary import tracking_error_w_m
from companion.cli.demo.fleet.report import Separated, VehicleReport
from companion.config.separation_config import SeparationConfig
from companion.core.types import Array

_SIZE_IN = (12.0, 6.5)
_THIN = 5
"""Cycles between two points of a curve."""


def draw(reports: Sequence[VehicleReport], pairs: Sequence[Separated], rules: SeparationConfig, path: Path) -> None:
    """Write the picture; format by suffix."""
    with style_of(Medium.PAGE):
        figure = Figure(figsize=_SIZE_IN, layout="constrained")
        above, over_time = figure.subfigures(1, 2, squeeze=False, width_ratios=(5.0, 7.0))[0]
        _draw_above(above.subplots(), reports)
        distance, height, error = over_time.subplots(3, 1, sharex=True)
        begin_s = min(float(report.record.columns["time_s"][0]) for report in reports)
        _draw_distance(distance, pairs, rules, begin_s)
        for colour, report in zip(COLOURS, reports, strict=False):
            times_s = _column(report, "time_s") - begin_s
            height.plot(times_s, _column(report, "position_w_m")[:, 2], color=colour, label=report.name)
            error.plot(times_s, 100.0 * _tracking_error_m(report), color=colour)
        height.set(ylabel="height (m)")
        height.legend(loc="lower right")
        error.set(xlabel="time (s)", ylabel="error (cm)")
        figure.suptitle(f"{len(reports)} vehicles in one room: {', '.join(report.name for report in reports)}")
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110)


def _draw_above(axes: Axes, reports: Sequence[VehicleReport]) -> None:
    for colour, report in zip(COLOURS, reports, strict=False):
        places = _column(report, "position_w_m")
        axes.plot(places[:, 0], places[:, 1], color=colour, label=report.name)
        axes.plot(places[0, 0], places[0, 1], "o", color=colour)
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="from above; dots: takeoff")
    axes.legend(loc="best")


def _draw_distance(axes: Axes, pairs: Sequence[Separated], rules: SeparationConfig, begin_s: float) -> None:
    for pair in pairs:
        shown = np.where(np.isfinite(pair.distance_m), pair.distance_m, np.nan)
        axes.plot(pair.times_s[::_THIN] - begin_s, shown[::_THIN], label=" – ".join(pair.names))
    axes.axhline(rules.radius_m, color="black", linestyle="--", label=f"least: {rules.radius_m:g} m")
    axes.set(ylabel="apart (m)", ylim=(0.0, None))
    axes.legend(loc="upper right")


def _column(report: VehicleReport, name: str) -> Array:
    return np.asarray(report.record.columns[name], dtype=float)[::_THIN]


def _tracking_error_m(report: VehicleReport) -> Array:
    """Return the distance to the reference while a trajectory was tracked, NaN otherwise, m."""
    columns = report.record.columns
    if report.summary is None:
        return np.full_like(_column(report, "time_s"), np.nan)
    error_m: Array = np.linalg.norm(tracking_error_w_m(columns), axis=1)
    return np.where(np.asarray(columns["phase"]) == "track", error_m, np.nan)[::_THIN]
