"""Common parts of all figures: sizes, colours, time axes with the phases shaded behind them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from enum import StrEnum
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from companion.analysis.report.recorded_flight import Flown, Mask
from companion.core.types import Array

AXES = ("x", "y", "z")
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Blue, orange, green, pink, yellow and light blue, which colour-blind readers can tell apart."""
GREY, RED = "0.45", "#b3261e"
PHASE_SHADES = {
    "takeoff": "#e8f1fa", "hold": "#f7f7f7", "track": "#fff3d9", "stow": "#e9f5ec", "land": "#f5e6f0",
    "handed over": "#fbe3dc", "terminated": "#f6cfc4",
}  # fmt: skip
"""Background of axes over time, by phase."""
_DPI = 150
_NARROW_IN = 5.0
_MOST_BESIDE = 3
"""Entries of a legend in one line of a narrow figure."""
ANGLES = ("roll", "pitch")


class Medium(StrEnum):
    """Medium that a figure is drawn for."""

    PAGE = "page"
    PAPER = "paper"
    """A column of a two-column paper."""


TEXT_WIDTH_IN = 7.16
"""Width of a figure over both columns of a paper."""
_WIDTHS_IN = {Medium.PAGE: (4.7, 9.6), Medium.PAPER: (3.5, 3.5)}
"""Widths of narrow and of wide figures."""
_LEFT_IN = {Medium.PAGE: 0.74, Medium.PAPER: 0.56}
"""Space for the labels left of axes over time, so that these axes line up in all figures of a page."""
_RIGHT_IN = 0.08
_EARLIEST_S = -5.0
"""Earliest time shown, since lift-off; earlier commands are marked at the left edge."""
_OVER_TIME = "over time"
_STYLES: dict[Medium, dict[str, Any]] = {
    Medium.PAGE: {"font.size": 9.0, "axes.titlesize": 9.0, "legend.fontsize": 8.0, "lines.linewidth": 1.1},
    Medium.PAPER: {
        "font.size": 8.0, "axes.titlesize": 8.0, "legend.fontsize": 7.0, "lines.linewidth": 0.9, "axes.linewidth": 0.6,
        "xtick.labelsize": 7.0, "ytick.labelsize": 7.0, "pdf.fonttype": 42,
    },
}  # fmt: skip
_ALWAYS = {"axes.grid": True, "grid.alpha": 0.3, "grid.linewidth": 0.6, "axes.axisbelow": True, "legend.frameon": False}


@dataclass(frozen=True)
class Chart:
    """One figure of a report."""

    name: str
    """Name of its file."""
    caption: str
    draw: Callable[[Figure], None]
    height_in: float
    wide: bool = True
    """True for the page's whole width; narrow figures stand in pairs."""
    paper_height_in: float | None = None
    """Height in a paper's column, inches, if it differs."""

    def figure(self, medium: Medium) -> Figure:
        """Return the drawn figure in the size of its medium."""
        height_in = self.paper_height_in if medium is Medium.PAPER and self.paper_height_in else self.height_in
        with style_of(medium):
            figure = Figure(figsize=(_WIDTHS_IN[medium][self.wide], height_in), layout="constrained")
            self.draw(figure)
            _align_left(figure, _LEFT_IN[medium])
            return figure

    def save(self, into: Path | BytesIO, medium: Medium) -> None:
        """Draw into a file, in the format of its suffix, or into memory as PNG."""
        figure = self.figure(medium)
        with style_of(medium):
            figure.savefig(into, dpi=300 if medium is Medium.PAPER else _DPI)


def style_of(medium: Medium) -> AbstractContextManager[object]:
    """Return the context in which figures have the fonts and lines of a medium."""
    return mpl.rc_context(_ALWAYS | _STYLES[medium])


def _align_left(figure: Figure, left_in: float) -> None:
    """Give all axes over time the same left and right edge, whatever their labels need."""
    rows = [axes for axes in figure.axes if axes.get_label() == _OVER_TIME]
    if not rows:
        return
    figure.draw_without_rendering()  # the layout is found while drawing
    figure.set_layout_engine("none")
    left, right = left_in / figure.get_figwidth(), 1.0 - _RIGHT_IN / figure.get_figwidth()
    for axes in rows:
        place = axes.get_position()
        axes.set_position((left, place.y0, right - left, place.height))


def stacked(figure: Figure | SubFigure, labels: Sequence[str], *, one_x: bool = True) -> list[Axes]:
    """Return axes below each other with these labels; `one_x`: with one x axis."""
    rows: list[Axes] = figure.subplots(len(labels), 1, sharex=one_x, squeeze=False)[:, 0].tolist()
    for axes, label in zip(rows, labels, strict=True):
        axes.set_ylabel(label)
    figure.align_ylabels(rows)
    return rows


def rows_over_time(figure: Figure | SubFigure, labels: Sequence[str], flown: Flown) -> list[Axes]:
    """Return axes below each other over the time since lift-off, the phases shaded behind all of them."""
    rows = stacked(figure, labels)
    for axes in rows:
        axes.set_label(_OVER_TIME)
        for stretch in flown.phases:
            if stretch.name in PHASE_SHADES:
                axes.axvspan(stretch.begin_s, stretch.end_s, color=PHASE_SHADES[stretch.name], zorder=0, lw=0)
    begin_s, end_s = _shown_s(flown)
    rows[0].set_xlim(begin_s, end_s)
    rows[-1].set_xlabel("time since lift-off (s)")
    return rows


def _shown_s(flown: Flown) -> tuple[float, float]:
    """Return the time shown: first command before lift-off until the motors stop; all of it without a flight."""
    if not flown.airborne.any():
        return float(flown.time_s[0]), max(float(flown.time_s[-1]), float(flown.time_s[0]) + 1.0)
    turning = flown.in_the_air | (flown.column("armed") > 0.0)
    last_s = float(flown.time_s[turning][-1])
    commands_s = [event.time_s - flown.zero_s - 0.5 for event in flown.record.events if event.kind == "command"]
    begin_s = max(min([-1.0, *commands_s]), _EARLIEST_S, float(flown.time_s[0]))
    return begin_s, min(float(flown.time_s[-1]), last_s + 1.0) + 1e-3


def shades_of(flown: Flown) -> dict[str, str]:
    """Return the phases of the flight in order, with their background colours."""
    return {one.name: PHASE_SHADES[one.name] for one in flown.phases if one.name in PHASE_SHADES}


def phase_patches(shades: Mapping[str, str]) -> list[Patch]:
    """Return legend handles of phases."""
    return [Patch(facecolor=colour, edgecolor="0.7", lw=0.4, label=name) for name, colour in shades.items()]


def xyz(axes: Axes, time_s: Array, values: Array, *, labels: bool = False, **how: Any) -> None:
    """Draw three curves (n, 3) in the colours of x, y and z."""
    for axis, (name, colour) in enumerate(zip(AXES, COLOURS, strict=False)):
        axes.plot(time_s, values[:, axis], color=colour, label=name if labels else None, **how)


def only(among: Mask, values: Array) -> Array:
    """Return the values with NaN outside of the mask, (n, ...), where curves then break."""
    return np.where(among.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)


def free_only(flown: Flown, values: Array) -> Array:
    """Return the values with NaN on the ground, where the law's values mean nothing, (n, ...)."""
    return only(flown.free, values)


def at_least_wide(axes: Axes, span: float) -> None:
    """Widen the limits of the y axis to at least `span`, so that noise does not look like motion."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def legend_of_axes(figure: Figure, **other: Any) -> None:
    """Draw a legend above the figure: `flown` in the colours of x, y and z, and other curves in their own."""
    ours = tuple(Line2D([], [], color=colour) for colour, _ in zip(COLOURS, AXES, strict=False))
    handles: list[Any] = [ours, *(Line2D([], [], **how) for how in other.values())]
    figure.legend(
        handles, ["flown", *other], loc="outside upper center", ncols=len(handles), handlelength=3.0,
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.0)},
    )  # fmt: skip


def legend_above(figure: Figure, axes: Axes, columns: int = 0) -> None:
    """Draw the legend of `axes` above the figure, outside of the curves."""
    handles, labels = axes.get_legend_handles_labels()
    most = 2 if figure.get_figwidth() < _NARROW_IN and len(labels) > _MOST_BESIDE else len(labels)
    figure.legend(handles, labels, loc="outside upper center", ncols=min(columns or most, most))


def symmetric(axes: Iterable[Axes]) -> None:
    """Give all axes the same y limits, so that they can be compared."""
    every = list(axes)
    low = min(one.get_ylim()[0] for one in every)
    high = max(one.get_ylim()[1] for one in every)
    for one in every:
        one.set_ylim(low, high)


def thinned(time_s: Array, *values: Array, most: int = 6000) -> tuple[Array, ...]:
    """Return at most `most` evenly spaced rows of each array, so that long flights are drawn quickly."""
    every = max(1, -(-len(time_s) // most))
    return tuple(one[::every] for one in (time_s, *values))


def histogram(axes: Axes, values: Array, bins: int | Sequence[float], colour: str = COLOURS[0]) -> None:
    """Draw a histogram with a logarithmic count axis, whose ticks are plain numbers."""
    axes.hist(values, bins=bins, color=colour)
    axes.set_yscale("log")
    axes.set_ylim(0.7, None)
    axes.yaxis.set_major_formatter("{x:g}")
