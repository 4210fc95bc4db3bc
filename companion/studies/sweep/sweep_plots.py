"""The picture of a sweep: error against every parameter, and which parameter it depends on."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.studies.sweep.sweep import Columns
from companion.studies.sweep.sweep_numbers import PARAMETERS, binned, blames, errors_m, group, nominals, of_nominal

mpl.use("Agg")  # pictures are files; no display is wanted or needed

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")  # told apart by colour-blind readers, too
_ACROSS = 4
_MARGIN = 1.3


def plot_sweep(columns: Columns, title: str, paths: list[Path]) -> None:
    """Write one page to every path, by its suffix."""
    figure = sweep_figure(columns, title)
    for path in paths:
        figure.savefig(path, dpi=110)


def sweep_figure(columns: Columns, title: str) -> Figure:
    """Return the page. What is beyond it or diverged is a cross at the upper edge."""
    figure = Figure(figsize=(16.0, 13.0), layout="constrained")
    rows_of_panels = -(-len(PARAMETERS) // _ACROSS)
    grid = figure.add_gridspec(rows_of_panels + 1, _ACROSS)
    each = [of_nominal(columns, nominal) for nominal in nominals(columns)]
    top_m = _MARGIN * max(_finite_p98_m(rows) for rows in each)
    for place, (name, label) in enumerate(PARAMETERS.items()):
        axes = figure.add_subplot(grid[divmod(place, _ACROSS)])
        for rows, colour in zip(each, _COLOURS, strict=False):
            _against(axes, rows, name, top_m, colour)
        axes.set_ylim(0.0, top_m)
        axes.set_xlabel(label)
        axes.grid(alpha=0.3)
        if place % _ACROSS == 0:
            axes.set_ylabel("error (m)")
    _ranking(figure.add_subplot(grid[rows_of_panels, :]), each)
    figure.suptitle(f"{title}. Line: median, dashes: 95 %, crosses: beyond the picture or diverged")
    return figure


def _finite_p98_m(rows: Columns) -> float:
    error = errors_m(rows)
    flown = error[np.isfinite(error)]
    return float(np.quantile(flown, 0.98)) if flown.size else 1.0


def _against(axes: Axes, rows: Columns, name: str, top_m: float, colour: str) -> None:
    """Every vehicle a dot; median and 95th percentile of the vehicles of a bin as lines."""
    values, error = rows[name], errors_m(rows)
    beyond, bins = error > top_m, binned(values)
    kinds, at = np.unique(values, return_inverse=True)
    x = at.astype(float) if values.dtype.kind == "U" else values
    axes.plot(x[~beyond], error[~beyond], ".", color=colour, ms=3.0, alpha=0.4, mew=0.0)
    edge = np.full(beyond.sum(), 0.985)
    axes.plot(x[beyond], edge, "x", color=colour, ms=4.0, alpha=0.6, transform=axes.get_xaxis_transform())
    inside = [bins == bin_ for bin_ in np.unique(bins)]
    middle = [np.median(x[where]) for where in inside]
    for share, style in ((0.5, "-"), (0.95, "--")):
        line = [np.quantile(error[where], share, method="inverted_cdf") for where in inside]
        axes.plot(middle, line, style, color=colour, lw=1.6)
    if values.dtype.kind == "U":
        axes.set_xticks(range(len(kinds)), kinds)
        axes.set_xlim(-0.5, len(kinds) - 0.5)


def _ranking(axes: Axes, each: list[Columns]) -> None:
    found = [blames(rows) for rows in each]
    share = np.nan_to_num([[blame.explained for blame in of_one] for of_one in found])
    order = np.argsort(share.mean(axis=0))
    height = 0.8 / len(each)
    for place, (rows, colour) in enumerate(zip(each, _COLOURS, strict=False)):
        numbers = group(rows)
        p95 = (
            f"95 % up to {numbers.error_p95_m:.3f} m" if np.isfinite(numbers.error_p95_m) else "more than 5 % diverged"
        )
        y = np.arange(len(order)) + (len(each) / 2.0 - place - 0.5) * height
        label = (
            f"{rows['nominal_radps'][0]:.1f} rad/s: {numbers.vehicles} vehicles, "
            f"median {numbers.error_p50_m:.3f} m, {p95}"
        )
        axes.barh(y, 100.0 * share[place, order], height, color=colour, label=label)
    names = [label.split(" (")[0] for label in PARAMETERS.values()]
    for row, parameter in enumerate(order):
        axes.text(100.0 * share[:, parameter].max() + 1.0, row, names[parameter], va="center", fontsize=9)
    axes.set_yticks([])
    axes.set_xlim(0.0, 130.0 * share.max() + 1.0)
    axes.set_xlabel("explains of the order of errors, alone (%)")
    axes.grid(alpha=0.3, axis="x")
    axes.legend(loc="lower right", fontsize=9)
