"""Errors of several flights in one figure for each trajectory."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from companion.analysis.report.charts import AXES, COLOURS, Chart, legend_above, stacked, thinned
from companion.analysis.report.number_tables import letters
from companion.analysis.report.recorded_flight import Flown, Mask


@dataclass(frozen=True)
class _Line:
    """Cycles of one flight; time counts from the first of them."""

    label: str
    colour: str
    dashed: bool
    flown: Flown
    mask: Mask


def overlaid(flights: Sequence[Flown]) -> list[Chart]:
    """Return a chart for each trajectory by name, from its own start; from lift-off where a flight has none."""
    if not all(flown.trajectories for flown in flights):
        lines = [
            _line(number, flown, flown.airborne, ", ".join(flown.law_names)) for number, flown in _lettered(flights)
        ]
        return [_chart("compared", "lift-off", lines)]
    by_name: dict[str, list[_Line]] = {}
    for number, flown in _lettered(flights):
        for one in flown.trajectories:
            before = by_name.setdefault(one.name, [])
            again = any(line.flown is flown for line in before)
            before.append(_line(number, flown, one.mask, one.law, again))
    if len(by_name) == 1:
        ((name, lines),) = by_name.items()
        return [_chart("compared", f"the start of the {name}", lines)]
    return [_chart(f"compared-{name}", f"the start of the {name}", lines) for name, lines in by_name.items()]


def _lettered(flights: Sequence[Flown]) -> list[tuple[tuple[str, str], Flown]]:
    """Return the flights, each with its letter and colour."""
    marks = [(letter, COLOURS[number % len(COLOURS)]) for number, letter in enumerate(letters(len(flights)))]
    return list(zip(marks, flights, strict=True))


def _line(mark: tuple[str, str], flown: Flown, mask: Mask, law: str, again: bool = False) -> _Line:
    letter, colour = mark
    return _Line(f"{letter}: {law or flown.name}{', again' if again else ''}", colour, again, flown, mask)


def _chart(name: str, since: str, lines: Sequence[_Line]) -> Chart:
    caption = f"Errors of the axes and their norm, from {since} on."
    return Chart(name, caption, partial(_draw, lines=lines, since=since), 6.0, wide=True, paper_height_in=4.6)


def _draw(figure: Figure, lines: Sequence[_Line], since: str) -> None:
    rows = stacked(figure, [f"{name} (cm)" for name in (*AXES, "norm")])
    for line in lines:
        if not line.mask.any():
            continue
        time = line.flown.time_s[line.mask]
        values = 100.0 * np.column_stack((line.flown.error_w_m[line.mask], line.flown.distance_m[line.mask]))
        time, values = thinned(time - time[0], values)
        for axes, column in zip(rows, values.T, strict=True):
            axes.plot(time, column, color=line.colour, label=line.label, lw=0.9, ls="--" if line.dashed else "-")
    for axes in rows:
        axes.axhline(0.0, color="k", lw=0.5)
    rows[-1].set_xlabel(f"time since {since} (s)")
    legend_above(figure, rows[0], min(len(lines), 4))
