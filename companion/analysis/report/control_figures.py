"""Figures of the law: triggers, network, filter and compensation; and of the latencies."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.analysis.report.charts import (
    ANGLES,
    AXES,
    COLOURS,
    free_only,
    histogram,
    legend_above,
    rows_over_time,
    stacked,
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
"""Signals of the paper's law: names in the record, and in the paper."""


_SHOWN = 99.8
"""Percentile up to which a histogram of latencies reaches."""


def signals_of(flown: Flown) -> tuple[tuple[str, str], ...]:
    """Return the signals that the record has."""
    return tuple((name, label) for name, label in SIGNALS if flown.has(f"law_{name}"))


def signals(figure: Figure, flown: Flown) -> None:
    """Draw errors, filtered command and compensation, as the paper names them."""
    found = signals_of(flown)
    rows = rows_over_time(figure, [label for _, label in found], flown)
    for axes, (name, _) in zip(rows, found, strict=True):
        time, values = thinned(flown.time_s, free_only(flown, flown.column(f"law_{name}")))
        xyz(axes, time, values, labels=True, lw=0.8)
    legend_above(figure, rows[0])


def friction(figure: Figure, flown: Flown) -> None:
    """Draw the output of the network, and of the disturbance observer where there is one."""
    rows = rows_over_time(figure, [f"{axis} (m/s²)" for axis in AXES], flown)
    time, learnt = thinned(flown.time_s, free_only(flown, flown.column("law_f_hat")))
    push = thinned(free_only(flown, flown.column("law_push", 3)))[0]
    for axis, axes in enumerate(rows):
        if np.abs(np.nan_to_num(push)).max() > 0.0:
            axes.plot(time, push[:, axis], color=COLOURS[2], lw=0.8, label="disturbance observer")
        axes.plot(time, learnt[:, axis], color=COLOURS[1], label=r"network, $\hat f_d$")
    symmetric(rows)
    legend_above(figure, rows[0])


def horizon(figure: Figure, flown: Flown) -> None:
    """Draw the error of the autopilot's horizon against motion capture, and its correction, in degrees."""
    rows = rows_over_time(figure, [f"{angle} (°)" for angle in ANGLES], flown)
    for axes, axis in zip(rows, ANGLES, strict=True):
        off, put_right = (np.degrees(flown.column(f"horizon_{part}{axis}_rad")) for part in ("off_", ""))
        time, off, put_right = thinned(flown.time_s, free_only(flown, off), free_only(flown, put_right))
        axes.plot(time, off, color=COLOURS[1], lw=2.6, alpha=0.4, label="difference")
        axes.plot(time, put_right, color=COLOURS[0], lw=0.8, label="correction")
    symmetric(rows)
    legend_above(figure, rows[0])


def weights(figure: Figure, flown: Flown) -> None:
    """Draw every weight, and the norm of each layer."""
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
    """Draw the time since the previous trigger at each trigger."""
    (axes,) = rows_over_time(figure, ["gap (ms)"], flown)
    draw_gaps(axes, flown)


def draw_gaps(axes: Axes, flown: Flown) -> None:
    """Draw the gap before each trigger in the air, ms."""
    at_s, gaps_s = flown.gaps_s(flown.airborne)
    axes.vlines(at_s, 0.0, 1e3 * gaps_s, color=COLOURS[0], lw=0.5)
    axes.plot(at_s, 1e3 * gaps_s, ".", color=COLOURS[0], ms=2.0)
    axes.set_ylim(0.0, None)


def gaps(figure: Figure, flown: Flown) -> None:
    """Draw the histogram of the time between two triggers."""
    draw_gap_histogram(figure.subplots(), flown)


def draw_gap_histogram(axes: Axes, flown: Flown) -> None:
    """Draw the histogram of gaps, ms, on trajectories only where any was flown."""
    among = flown.tracked if flown.tracked.any() else flown.airborne
    gaps_ms = 1e3 * flown.gaps_s(among)[1]
    top_ms = max(float(gaps_ms.max(initial=0.0)), 1e-9)
    bins = np.linspace(0.0, top_ms * 1.001, 41)
    if gaps_ms.size and (np.abs(gaps_ms / 10.0 - np.round(gaps_ms / 10.0)) < 0.2).mean() > 0.8:  # whole cycles of 10 ms
        bins = whole_cycle_bins(top_ms)
    histogram(axes, gaps_ms, bins.tolist())
    axes.set(xlabel="time between triggers (ms)", ylabel="triggers")


def whole_cycle_bins(top_ms: float) -> Array:
    """Return edges between multiples of 10 ms, about 60 bins at most, the last one beyond `top_ms`."""
    wide_ms = 10.0 * max(1.0, np.ceil(top_ms / 600.0))
    return np.arange(5.0, max(top_ms, 15.0) + wide_ms, wide_ms)


def latencies(figure: Figure, flown: Flown) -> None:
    """Draw a histogram of each latency, ms."""
    found = flown.latencies_s()
    rows = stacked(figure, ["cycles"] * len(found), one_x=False)
    for axes, (name, seconds) in zip(rows, found.items(), strict=True):
        all_ms = 1e3 * seconds
        limit_ms = max(float(np.percentile(all_ms, _SHOWN)), 1e-3) * 1.02
        histogram(axes, np.minimum(all_ms, limit_ms), 60)
        axes.set_title(name, loc="left")
        axes.axvline(float(np.median(all_ms)), color="k", lw=0.8, ls="--")
    rows[-1].set_xlabel("latency (ms)")
