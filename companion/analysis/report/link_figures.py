"""Figures of the link to a law on the ground: its traffic over time, and the ages of its messages."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.analysis.report.charts import COLOURS, RED, histogram, legend_above, rows_over_time
from companion.analysis.report.link_numbers import COUNTED, limits_of
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.summary import message_ages_s
from companion.core.types import Array

_BIN_S = 1.0
"""About the time in which the ground tells its counts once."""
_LEAST_BIN_S = 0.5
_SHOWN = 99.8
"""Percentile up to which a histogram reaches."""
_KINDS = (("events", COLOURS[0]), ("again", COLOURS[1]), ("beats", COLOURS[5]))


def link(figure: Figure, flown: Flown) -> None:
    """Draw messages and payload a second, the age of each message, and the silence with its limits."""
    labels = ["messages (1/s)", "payload (kB/s)", "age (ms)", "silence (ms)"]
    messages, payload, ages, silence = rows_over_time(figure, labels, flown)
    _messages(messages, flown)
    _payload(payload, flown)
    _ages(ages, flown)
    _silence(silence, flown)
    legend_above(figure, messages)


def _edges_s(flown: Flown) -> Array:
    """Return the edges of the bins: seconds in which the law flew, and what is left at the end."""
    flying = flown.time_s[flown.airborne]
    first_s, last_s = float(flying[0]), float(flying[-1])
    whole_s = np.arange(first_s, last_s + 1e-9, _BIN_S)
    return whole_s if last_s - whole_s[-1] < _LEAST_BIN_S else np.append(whole_s, last_s)


def _rates(flown: Flown, column: str, edges_s: Array) -> Array:
    """Return how fast a count grows in each bin, 1/s."""
    counts = np.interp(edges_s, flown.time_s, np.nan_to_num(flown.column(column)))
    return np.asarray(np.diff(counts) / np.diff(edges_s))


def _messages(axes: Axes, flown: Flown) -> None:
    """Draw bars of events, repeats and beats on each other, and the losses."""
    edges_s = _edges_s(flown)
    below = np.zeros(max(len(edges_s) - 1, 0))
    for kind, colour in _KINDS:
        rates = np.maximum(_rates(flown, f"link_{kind}", edges_s), 0.0)
        axes.bar(edges_s[:-1], rates, np.diff(edges_s), below, align="edge", color=colour, lw=0, label=kind)
        below = below + rates
    lost = np.maximum(_rates(flown, "link_lost", edges_s), 0.0)
    axes.stairs(lost, edges_s, baseline=None, color=RED, lw=1.1, label="lost")
    axes.set_ylim(0.0, None)


def _payload(axes: Axes, flown: Flown) -> None:
    """Draw what has arrived from the ground, and what was sent to it."""
    edges_s, top = _edges_s(flown), 0.0
    for column, label, colour in (("link_bytes_received", "up", COLOURS[0]), ("link_bytes_down", "down", COLOURS[2])):
        rates = 1e-3 * _rates(flown, column, edges_s)
        axes.stairs(rates, edges_s, baseline=None, color=colour, lw=1.1, label=label)
        top = max(top, float(rates.max(initial=0.0)))
    axes.set_ylim(0.0, 1.5 * top or 1.0)
    axes.legend(loc="upper left", ncols=2)


def _ages(axes: Axes, flown: Flown) -> None:
    """Draw the age of each message at its arrival."""
    arrived_s = flown.column("link_message_arrived_s")
    ages_ms = 1e3 * (arrived_s - flown.column("link_message_sent_s"))
    newest = np.diff(arrived_s, prepend=np.nan) != 0.0
    at_s = arrived_s - flown.zero_s
    axes.plot(at_s[newest], ages_ms[newest], ".", color=COLOURS[0], ms=1.5)
    axes.set_ylim(0.0, None)


def _silence(axes: Axes, flown: Flown) -> None:
    """Draw the age of the command in use, by what the ground has confirmed, and the limits that it has reached."""
    silence_ms = 1e3 * np.where(flown.airborne, flown.column("link_command_age_s"), np.nan)
    axes.plot(flown.time_s, silence_ms, color="0.25", lw=0.5)
    top_ms = float(np.nanmax(silence_ms))
    limits = sorted(limits_of(flown).items(), key=lambda one: one[1])
    above = [number for number, (_, limit_s) in enumerate(limits) if 1e3 * limit_s > top_ms]
    shown = limits[: above[0] + 1] if above else limits
    for number, (effect, limit_s) in enumerate(shown):
        axes.axhline(1e3 * limit_s, color=RED, lw=0.8, ls="--")
        left, below = number % 2 == 0, number == 0  # neighbours may lie close together
        axes.annotate(
            effect, (0.0 if left else 1.0, 1e3 * limit_s), (3 if left else -3, -1 if below else 1),
            xycoords=("axes fraction", "data"), textcoords="offset points",
            ha="left" if left else "right", va="top" if below else "bottom", color=RED, fontsize="small",
        )  # fmt: skip
    most_ms = max([top_ms, *(1e3 * limit_s for _, limit_s in shown)])
    axes.set_ylim(0.0, 1.25 * min(most_ms, 2e3))


def message_ages(figure: Figure, flown: Flown) -> None:
    """Draw the histogram of the ages of messages at their arrival."""
    ages_s = message_ages_s(flown.record.columns, flown.airborne)
    _histogram(figure, 1e3 * ages_s[np.isfinite(ages_s)], "age at the arrival (ms)")


def message_gaps(figure: Figure, flown: Flown) -> None:
    """Draw the histogram of the time from one message's arrival to the next one's."""
    arrived_s = flown.column("link_message_arrived_s")[flown.airborne]
    newest = arrived_s[np.diff(arrived_s, prepend=np.nan) != 0.0]
    _histogram(figure, 1e3 * np.diff(newest[np.isfinite(newest)]), "time between two arrivals (ms)")


def _histogram(figure: Figure, values_ms: Array, label: str) -> None:
    axes = figure.subplots()
    if values_ms.size:
        limit_ms = max(float(np.percentile(values_ms, _SHOWN)), 1e-3) * 1.02
        histogram(axes, np.minimum(values_ms, limit_ms), 60)
        for share, style in ((50.0, "--"), (99.0, ":")):
            axes.axvline(float(np.percentile(values_ms, share)), color="k", lw=0.8, ls=style)
    axes.set(xlabel=label, ylabel="messages")


def has_link(flown: Flown) -> bool:
    """Return True for the record of a vehicle that a law on the ground flew."""
    return flown.has(COUNTED) and flown.has("link_message_arrived_s") and bool(flown.airborne.any())
