"""One-page picture of a flight, from the parts of a report."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from companion.analysis.report.charts import Medium, phase_patches, rows_over_time, shades_of, style_of, thinned, xyz
from companion.analysis.report.control_figures import draw_gap_histogram, draw_gaps
from companion.analysis.report.motion_figures import (
    GOAL,
    above_height_in,
    draw_above,
    draw_arms,
    draw_command,
    draw_errors,
)
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.summary import Columns, Summary
from companion.records.read import FlightRecord

_WIDTHS_IN = (4.7, 7.3)
_ROW_IN = 1.45
_NUMBERS_IN = 1.5
_LABELS = ("position (m)", "error (cm)", "command u (m/s²)", "trigger gap (ms)")
_ARMS = ("right arm (°)", "left arm (°)")


def plot_flight(columns: Columns, summary: Summary | None, title: str, path: Path) -> None:
    """Write path, numbers, and position, error, command, trigger gaps and joints over time; format by suffix."""
    flown = Flown(FlightRecord(path=path, columns=columns))
    labels = [*_LABELS, *(_ARMS if flown.has("joint_position_rad") else ())]
    with style_of(Medium.PAGE):
        figure = Figure(figsize=(sum(_WIDTHS_IN), 0.9 + _ROW_IN * len(labels)), layout="constrained")
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=_WIDTHS_IN)[0]
        above_in = above_height_in(flown, _WIDTHS_IN[0]) + 0.4
        heights_in = (above_in, _NUMBERS_IN, figure.get_figheight() - above_in - _NUMBERS_IN)
        above, words, histogram = left.subplots(3, 1, height_ratios=heights_in)
        draw_above(above, flown)
        above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        _write_numbers(words, summary)
        draw_gap_histogram(histogram, flown)
        rows = rows_over_time(right, labels, flown)
        _draw_rows(rows, flown)
        curves = [*rows[1].get_legend_handles_labels()[0], Line2D([], [], label="reference", **GOAL)]
        handles = [*curves, *phase_patches(shades_of(flown))]
        right.legend(handles=handles, loc="outside upper center", ncols=9, columnspacing=1.0, handlelength=1.4)
        figure.suptitle(title)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110)


def _draw_rows(rows: list[Axes], flown: Flown) -> None:
    position, error, command, gaps, *arms = rows
    time, where, reference = thinned(flown.time_s, flown.position_w_m, flown.reference_w_m)
    position.plot(time, reference, **GOAL)
    xyz(position, time, where)
    draw_errors(error, flown)
    draw_command([command], flown)
    draw_gaps(gaps, flown)
    if arms:
        draw_arms(arms, flown)
        arms[0].legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=3)


def _write_numbers(axes: Axes, summary: Summary | None) -> None:
    axes.axis("off")
    lines = ["no trajectory was tracked"]
    if summary is not None:
        errors = (("mean", summary.mean_error_m), ("RMS", summary.rms_error_m), ("max", summary.max_error_m))
        lines = ["error (cm)       x       y       z"]
        lines += [f"{name:<10}" + "".join(f" {value:7.2f}" for value in 100.0 * np.array(of)) for name, of in errors]
        lines.append(f"updates in {summary.update_share:.1%} of {summary.control_cycles} cycles")
    axes.text(0.0, 0.95, "\n".join(lines), va="top", family="monospace", fontsize=10)
