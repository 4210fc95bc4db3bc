"""Picture of a search: error against updates of each generation, and the checked centres."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from companion.analysis.report.charts import COLOURS, Medium, style_of
from companion.studies.tuning.search import ERROR_M, UPDATES, Generation, Point, front_of


def plot_search(progress: Sequence[Generation], checked: Sequence[Point], best: Point | None, path: Path) -> None:
    """Write the picture in the format of the path's suffix."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with style_of(Medium.PAGE):
        _figure(progress, checked, best).savefig(path, dpi=150)


def _figure(progress: Sequence[Generation], checked: Sequence[Point], best: Point | None) -> Figure:
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.subplots()
    weights = sorted({generation.weight for generation in progress})
    for weight, colour in zip(weights, COLOURS * len(weights), strict=False):
        run = [one for one in progress if one.weight == weight]
        updates, error_cm = [100.0 * one.update_share for one in run], [100.0 * one.error_m for one in run]
        axes.plot(updates, error_cm, "-", lw=0.5, color=colour, alpha=0.4)
        axes.scatter(updates, error_cm, s=8, color=colour, alpha=0.6, label=f"generations, weight {weight:g} (medians)")
    front = front_of(checked)
    axes.plot([100.0 * u for u, _ in front], [100.0 * e for _, e in front], "k--", lw=0.8)
    axes.scatter(
        [100.0 * u for u, _ in checked],
        [100.0 * e for _, e in checked],
        s=30,
        color="k",
        label="checked elsewhere",
    )
    if best is not None:
        axes.scatter([100.0 * best[0]], [100.0 * best[1]], s=140, facecolors="none", edgecolors="k", label="written")
    axes.plot(100.0 * UPDATES, 100.0 * ERROR_M, "*", ms=12, color="0.5", label="target")
    axes.set(xlabel="updates (% of the cycles)", ylabel="mean error (cm)", xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("{x:g}")
    axes.grid(which="both")
    axes.legend()
    return figure
