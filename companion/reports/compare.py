"""Several flights' errors over each other."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from companion.reports.charts import AXES, COLOURS, Chart, legend_above, thinned
from companion.reports.flown import Flown
from companion.reports.words import letters


def overlaid(flights: Sequence[Flown]) -> Chart:
    """From the begin of the trajectory where all flew one, else from lift-off."""
    tracking = all(flown.tracked.any() for flown in flights)
    since = "the trajectory's begin" if tracking else "lift-off"
    caption = f"Errors per axis and their size, from {since} on."
    return Chart(
        "compared", caption, lambda figure: _draw(figure, flights, tracking, since), 6.0, wide=True, paper_height_in=4.6
    )


def _draw(figure: Figure, flights: Sequence[Flown], tracking: bool, since: str) -> None:
    rows = figure.subplots(4, 1, sharex=True)
    for number, (letter, flown) in enumerate(zip(letters(len(flights)), flights, strict=True)):
        shown = flown.tracked if tracking else flown.airborne
        if not shown.any():
            continue
        time = flown.time_s[shown]
        values = np.column_stack((flown.error_w_m[shown], flown.distance_m[shown]))
        time, values = thinned(time - time[0], values)
        label = f"{letter}: {', '.join(flown.law_names) or flown.name}"
        for axes, column in zip(rows, values.T, strict=True):
            axes.plot(time, column, color=COLOURS[number % len(COLOURS)], label=label, lw=0.9)
    for axes, name in zip(rows, (*AXES, "norm"), strict=True):
        axes.axhline(0.0, color="k", lw=0.5)
        axes.set_ylabel(f"{name} (m)")
    rows[-1].set_xlabel(f"time since {since} (s)")
    figure.align_ylabels(rows)
    legend_above(figure, rows[0], min(len(flights), 4))
