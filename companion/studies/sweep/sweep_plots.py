"""The picture of a sweep: error against every parameter, and which parameter it depends on."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from companion.analysis.report.charts import COLOURS, TEXT_WIDTH_IN, Medium, style_of
from companion.studies.sweep.sweep import Columns
from companion.studies.sweep.sweep_numbers import binned, blames, errors_m, group, nominals, of_nominal, parameters

_ACROSS = 4
_MARGIN = 1.3


def plot_sweep(columns: Columns, title: str, paths: list[Path]) -> None:
    """Write the figure to every path, in the format of its suffix."""
    with style_of(Medium.PAPER):
        figure = sweep_figure(columns, title)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # found once; it takes longer than the drawing
        for path in paths:
            figure.savefig(path, dpi=200)


def sweep_figure(columns: Columns, title: str) -> Figure:
    """Return the figure; larger errors and diverged vehicles are crosses at the upper edge."""
    figure = Figure(figsize=(TEXT_WIDTH_IN, 8.0), layout="constrained")
    shown = parameters(columns)
    rows_of_panels = -(-len(shown) // _ACROSS)
    grid = figure.add_gridspec(rows_of_panels + 1, _ACROSS)
    each = [of_nominal(columns, nominal) for nominal in nominals(columns)]
    top_m = _MARGIN * max(_finite_p98_m(rows) for rows in each)
    for number, (name, label) in enumerate(shown.items()):
        axes = figure.add_subplot(grid[divmod(number, _ACROSS)])
        for rows, colour in zip(each, COLOURS, strict=False):
            _against(axes, rows, name, top_m, colour)
        axes.set(ylim=(0.0, 100.0 * top_m), xlabel=label)
        if number % _ACROSS == 0:
            axes.set_ylabel("error (cm)")
        else:
            axes.tick_params(labelleft=False)
    _ranking(figure.add_subplot(grid[rows_of_panels, :]), each, list(shown.values()))
    marks = {"median": {"ls": "-"}, "95 %": {"ls": "--"}, "larger or diverged": {"ls": "", "marker": "x"}}
    lines = [Line2D([], [], color=colour, label=_words(rows)) for rows, colour in zip(each, COLOURS, strict=False)]
    lines += [Line2D([], [], color="0.3", label=name, **how) for name, how in marks.items()]  # type: ignore[arg-type]
    figure.legend(handles=lines, loc="outside upper center", ncols=3, title=title)
    return figure


def _words(rows: Columns) -> str:
    """Return the legend of one nominal bandwidth."""
    numbers = group(rows)
    known = np.isfinite(numbers.error_p95_m)
    p95 = f"95 % up to {100.0 * numbers.error_p95_m:.1f} cm" if known else "more than 5 % diverged"
    median = f"median {100.0 * numbers.error_p50_m:.1f} cm" if np.isfinite(numbers.error_p50_m) else "half diverged"
    return f"{rows['nominal_radps'][0]:.1f} rad/s: {numbers.vehicles} vehicles, {median}, {p95}"


def _finite_p98_m(rows: Columns) -> float:
    error = errors_m(rows)
    flown = error[np.isfinite(error)]
    return float(np.quantile(flown, 0.98)) if flown.size else 1.0


def _against(axes: Axes, rows: Columns, name: str, top_m: float, colour: str) -> None:
    """Draw a dot for each vehicle, and median and 95th percentile of each bin as lines."""
    values, error = rows[name], errors_m(rows)
    beyond, bins = error > top_m, binned(values)
    kinds, at = np.unique(values, return_inverse=True)
    x = at.astype(float) if values.dtype.kind == "U" else values
    axes.plot(x[~beyond], 100.0 * error[~beyond], ".", color=colour, ms=_dot(len(x)), alpha=0.5, mew=0.0)
    edge = np.full(beyond.sum(), 0.985)
    axes.plot(x[beyond], edge, "x", color=colour, ms=3.0, alpha=0.6, transform=axes.get_xaxis_transform())
    inside = [bins == bin_ for bin_ in np.unique(bins)]
    middle = [np.median(x[where]) for where in inside]
    for share, style in ((0.5, "-"), (0.95, "--")):
        line = [np.quantile(error[where], share, method="inverted_cdf") for where in inside]
        axes.plot(middle, 100.0 * np.array(line), style, color=colour, lw=1.2)
    if values.dtype.kind == "U":
        axes.set_xticks(range(len(kinds)), kinds)
        axes.set_xlim(-0.5, len(kinds) - 0.5)
    else:
        axes.xaxis.set_major_locator(MaxNLocator(nbins=4))


def _dot(vehicles: int) -> float:
    """Return the size of a dot, points: smaller where there are thousands."""
    return float(np.clip(60.0 / np.sqrt(vehicles), 2.0, 5.0))


def _ranking(axes: Axes, each: list[Columns], labels: list[str]) -> None:
    found = [blames(rows) for rows in each]
    share = np.nan_to_num([[blame.explained for blame in of_one] for of_one in found])
    order = np.argsort(share.mean(axis=0))
    height = 0.8 / len(each)
    for number, colour in zip(range(len(each)), COLOURS, strict=False):
        y = np.arange(len(order)) + (len(each) / 2.0 - number - 0.5) * height
        axes.barh(y, 100.0 * share[number, order], height, color=colour)
    names = [label.split(" (")[0] for label in labels]
    for row, parameter in enumerate(order):
        axes.text(100.0 * share[:, parameter].max() + 0.5, row, names[parameter], va="center", fontsize="small")
    axes.set_yticks([])
    axes.set_xlim(0.0, max(130.0 * share.max(), 10.0))
    few = "" if share.any() else "; too few vehicles to tell"
    axes.set_xlabel(f"variance of the errors' ranks explained by one parameter alone (%){few}")
