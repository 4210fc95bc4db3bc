"""Figures of what the law did inside: triggers, network, filter and compensation; and how long all took."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.analysis.report.charts import (
    AXES,
    COLOURS,
    free_only,
    legend_above,
    percentile_limit,
    rows_over_time,
    symmetric,
    thinned,
    xyz,
)
from companion.analysis.report.recorded_flight import Flown
from companion.core.types import Array

SIGNALS = (
    ("y1", "$y_1$ (m)"),
    ("y2", "$y_2$ (m/s)"),
    ("chi", r"$\chi$"),
    ("iota1", r"$\iota_1$"),
    ("iota2", r"$\iota_2$"),
)
"""Of the paper's law; names in the record, and how the paper writes them."""


def signals_of(flown: Flown) -> tuple[tuple[str, str], ...]:
    """Those that the record has."""
    return tuple((name, label) for name, label in SIGNALS if flown.has(f"law_{name}"))


def signals(figure: Figure, flown: Flown) -> None:
    """Errors, filtered command and compensation, as the paper names them."""
    found = signals_of(flown)
    rows = rows_over_time(figure, [label for _, label in found], flown)
    for axes, (name, _) in zip(rows, found, strict=True):
        time, values = thinned(flown.time_s, free_only(flown, flown.column(f"law_{name}")))
        xyz(axes, time, values, labels=True, lw=0.8)
    legend_above(figure, rows[0])


def friction(figure: Figure, flown: Flown) -> None:
    """The network's output, and the push that the observer saw, where there is one."""
    rows = rows_over_time(figure, [f"{axis} (m/s²)" for axis in AXES], flown)
    time, learnt = thinned(flown.time_s, free_only(flown, flown.column("law_f_hat")))
    push = thinned(free_only(flown, flown.column("law_push", 3)))[0]
    for axis, axes in enumerate(rows):
        if np.abs(np.nan_to_num(push)).max() > 0.0:
            axes.plot(time, push[:, axis], color=COLOURS[2], lw=0.8, label="observed push")
        axes.plot(time, learnt[:, axis], color=COLOURS[1], label=r"$\hat f_d$, network")
    symmetric(rows)
    legend_above(figure, rows[0])


def horizon(figure: Figure, flown: Flown) -> None:
    """Draw the error of the autopilot's horizon against motion capture, and its correction, in degrees."""
    rows = rows_over_time(figure, [f"{axis} (°)" for axis in ("roll", "pitch")], flown)
    for axes, axis in zip(rows, ("roll", "pitch"), strict=True):
        off, put_right = (np.degrees(flown.column(f"horizon_{part}{axis}_rad")) for part in ("off_", ""))
        time, off, put_right = thinned(flown.time_s, free_only(flown, off), free_only(flown, put_right))
        axes.plot(time, off, color=COLOURS[1], label="off motion capture's")
        axes.plot(time, put_right, color=COLOURS[0], lw=0.8, label="corrected")
    symmetric(rows)
    legend_above(figure, rows[0])


def weights(figure: Figure, flown: Flown) -> None:
    """Every weight, and the size of each layer."""
    layers = [
        (name, free_only(flown, flown.column(f"law_{name}"))) for name in ("v0", "v1") if flown.has(f"law_{name}")
    ]
    rows = rows_over_time(figure, [rf"$\hat V_{name[1]}$" for name, _ in layers], flown)
    for axes, (_, layer), colour in zip(rows, layers, COLOURS, strict=False):
        time, flat = thinned(flown.time_s, layer.reshape(len(layer), -1))
        axes.plot(time, flat, color=colour, lw=0.5, alpha=0.45)
        axes.plot(time, np.sqrt((flat**2).sum(axis=1)), color="k", lw=1.0, label="Frobenius norm")
    legend_above(figure, rows[0])


def events(figure: Figure, flown: Flown) -> None:
    """Every trigger at its instant, as high as the time since the one before."""
    (axes,) = rows_over_time(figure, ["since the last\ntrigger (ms)"], flown)
    at_s, gaps_s = flown.gaps_s(flown.airborne)
    axes.vlines(at_s, 0.0, 1e3 * gaps_s, color=COLOURS[0], lw=0.5)
    axes.plot(at_s, 1e3 * gaps_s, ".", color=COLOURS[0], ms=2.0)
    axes.set_ylim(0.0, None)


def gaps(figure: Figure, flown: Flown) -> None:
    """Draw the histogram of the time between two triggers."""
    among = flown.tracked if flown.tracked.any() else flown.airborne
    gaps_ms = 1e3 * flown.gaps_s(among)[1]
    axes = figure.subplots()
    _histogram(axes, gaps_ms, COLOURS[0])
    axes.set(xlabel="time between triggers (ms)", ylabel="triggers")


def _histogram(axes: Axes, values: Array, colour: str) -> None:
    top = max(float(values.max(initial=0.0)), 1e-9)
    bins = np.linspace(0.0, top * 1.001, 41)
    if values.size and (np.abs(values / 10.0 - np.round(values / 10.0)) < 0.2).mean() > 0.8:  # whole cycles of 10 ms
        bins = whole_cycle_bins(top)
    axes.hist(values, bins=bins.tolist(), color=colour)
    axes.set_yscale("log")
    axes.set_ylim(0.7, None)


def whole_cycle_bins(top_ms: float) -> Array:
    """Return edges between multiples of 10 ms, at most some 60 bins, the last one beyond `top_ms`."""
    wide_ms = 10.0 * max(1.0, np.ceil(top_ms / 600.0))
    return np.arange(5.0, max(top_ms, 15.0) + wide_ms, wide_ms)


def latencies(figure: Figure, flown: Flown) -> None:
    """A histogram each, on one axis of time."""
    found = flown.latencies_s()
    rows: list[Axes] = figure.subplots(len(found), 1, squeeze=False)[:, 0].tolist()
    for axes, (name, seconds), colour in zip(rows, found.items(), COLOURS, strict=False):
        all_ms = 1e3 * seconds
        limit_ms = max(percentile_limit(all_ms), 1e-3) * 1.02
        axes.hist(np.minimum(all_ms, limit_ms), bins=60, color=colour)
        axes.set_yscale("log")
        axes.set_ylim(0.7, None)
        axes.set_title(name, loc="left")
        axes.axvline(float(np.median(all_ms)), color="k", lw=0.8, ls="--")
    rows[-1].set_xlabel("ms (the last bar holds all beyond; dashed: median)")
    for axes in rows:
        axes.set_ylabel("cycles")
