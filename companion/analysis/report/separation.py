"""Other vehicles of a recorded flight: figures of their paths and distances, and how near they came."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from companion.analysis.report.charts import COLOURS, legend_above, only, rows_over_time, thinned
from companion.analysis.report.motion_figures import PALE
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.tables import Cell, Grid
from companion.core.types import Array

_NOTE = (
    "Each other vehicle at the instant, with the law in charge, at which it was nearest to the cylinder around it "
    "(docs/separation.md; negative: inside), and the longest time for which it was not seen."
)
_LOST_S = 0.5
"""Time unseen from which a position is a guess."""


@dataclass(frozen=True, kw_only=True)
class SeparationNumbers:
    """Nearest approach of one other vehicle to the cylinder around it, in the air."""

    body: str
    gap_m: float
    """Least distance to the cylinder; negative inside."""
    at_s: float
    """Time since lift-off."""
    horizontal_m: float
    """Horizontal distance at that time."""
    height_m: float
    """Difference of heights at that time, own less the other's."""
    unseen_s: float
    """Longest time for which it was not seen."""


def has_others(flown: Flown) -> bool:
    """Return True for a flight in a room of several vehicles, one of which was seen."""
    return flown.has("others_position_w_m") and bool(flown.airborne.any())


def separation_numbers(flown: Flown) -> tuple[SeparationNumbers, ...]:
    """Return the nearest approach of each other vehicle that was seen; none in a room of one vehicle."""
    if not has_others(flown):
        return ()
    found = (_nearest(flown, index, body) for index, body in enumerate(flown.record.other_names))
    return tuple(one for one in found if one is not None)


def _nearest(flown: Flown, index: int, body: str) -> SeparationNumbers | None:
    beside_m, above_m = _distances_m(flown, index)
    gap_m = np.where(flown.airborne, _gap_m(flown, index, beside_m, above_m), np.nan)
    if not np.isfinite(gap_m).any():
        return None
    row, unseen_s = int(np.nanargmin(gap_m)), flown.column("others_unseen_s")[:, index][flown.airborne]
    return SeparationNumbers(
        body=body,
        gap_m=float(gap_m[row]),
        at_s=float(flown.time_s[row]),
        horizontal_m=float(beside_m[row]),
        height_m=float(above_m[row]),
        unseen_s=float(np.max(unseen_s[np.isfinite(unseen_s)], initial=0.0)),
    )


def _distances_m(flown: Flown, index: int) -> tuple[Array, Array]:
    """Return horizontal distance and difference of heights (n,), m."""
    off = flown.position_w_m - flown.column("others_position_w_m")[:, index]
    return np.hypot(off[:, 0], off[:, 1]), off[:, 2]


def _gap_m(flown: Flown, index: int, beside_m: Array, above_m: Array) -> Array:
    radius_m, height_m, parked_height_m = _cylinder_m(flown)
    heights_m = np.where(flown.column("others_parked")[:, index] > 0.0, parked_height_m, height_m)
    return np.asarray(np.maximum(beside_m - radius_m, np.abs(above_m) - heights_m))


def _cylinder_m(flown: Flown) -> tuple[float, float, float]:
    """Return radius, height and height of a parked one's cylinder, m, as the record's configuration has them."""
    table = flown.record.metadata["config"]["separation"]
    return float(table["radius_m"]), float(table["height_m"]), float(table["parked_height_m"])


def others(figure: Figure, flown: Flown) -> None:
    """Draw all paths from above, and the cylinder around each other vehicle where it was nearest."""
    axes, angle = figure.subplots(), np.linspace(0.0, 2.0 * np.pi, 73)
    shown = only(flown.airborne, flown.position_w_m)
    axes.plot(shown[:, 0], shown[:, 1], color=COLOURS[0], label="flown")
    radius_m, nearest = _cylinder_m(flown)[0], {one.body: one for one in separation_numbers(flown)}
    for index, body in enumerate(flown.record.other_names):
        if body not in nearest:
            continue
        colour, path = COLOURS[1 + index % (len(COLOURS) - 1)], flown.column("others_position_w_m")[:, index]
        axes.plot(*only(flown.airborne, path)[:, :2].T, color=colour, label=body)
        row = int(np.argmin(np.abs(flown.time_s - nearest[body].at_s)))
        x, y = path[row, :2]
        axes.plot(x + radius_m * np.cos(angle), y + radius_m * np.sin(angle), color=colour, ls="--", lw=0.8)
        axes.plot(*flown.position_w_m[row, :2], "o", color=colour, ms=4.0)
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", adjustable="datalim")
    legend_above(figure, axes)


def separation(figure: Figure, flown: Flown) -> None:
    """Draw horizontal distance and difference of heights to each other vehicle; pale while it was not seen."""
    top, below = rows_over_time(figure, ["horizontal (m)", "vertical (m)"], flown)
    radius_m, height_m, _ = _cylinder_m(flown)
    for index, body in enumerate(flown.record.other_names):
        lost = flown.column("others_unseen_s")[:, index] > _LOST_S
        for axes, values in zip((top, below), _distances_m(flown, index), strict=True):
            time, seen, guessed = thinned(flown.time_s, np.where(lost, np.nan, values), np.where(lost, values, np.nan))
            axes.plot(time, seen, color=COLOURS[1 + index % (len(COLOURS) - 1)], label=body)
            axes.plot(time, guessed, **PALE)
    top.axhline(radius_m, color="k", lw=0.8, ls="--")
    for side in (-1.0, 1.0):
        below.axhline(side * height_m, color="k", lw=0.8, ls="--")
    top.set_ylim(0.0, None)
    legend_above(figure, top)


def separation_table(numbers: tuple[SeparationNumbers, ...]) -> Grid | None:
    """Return the table of nearest approaches; None in a room of one vehicle."""
    if not numbers:
        return None
    rows = tuple(
        (
            Cell(one.body),
            *(Cell(f"{value:.2f}") for value in (one.gap_m, one.horizontal_m, one.height_m, one.at_s, one.unseen_s)),
        )
        for one in numbers
    )
    columns = ("", "to its cylinder (m)", "horizontal (m)", "above it (m)", "since lift-off (s)", "unseen (s)")
    return Grid("Other vehicles", columns, rows, _NOTE)
