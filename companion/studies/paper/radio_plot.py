"""Picture of the radio's price: error over payload bytes a second, a line for each trigger."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from companion.analysis.report.charts import COLOURS, TEXT_WIDTH_IN, Medium, style_of
from companion.studies.paper.radio_table import TRIGGERS, Result

_MARKS = {"jitter 50 ms": "s", "jitter 20 ms": "^", "burst 100 ms": "D", "": "o"}
"""Marker of a radio, by the first words that are in its sentence."""
_NAMES = {"o": "no jitter", "^": "20 ms of jitter", "s": "50 ms of jitter", "D": "30 % in bursts of 100 ms"}


def draw(results: Sequence[Result], path: Path) -> None:
    """Write the figure, in the format of the file's suffix."""
    with style_of(Medium.PAPER):
        figure = radio_figure(results)
        figure.savefig(path, dpi=200)


def radio_figure(results: Sequence[Result]) -> Figure:
    """Return the figure; a line joins 0, 10 and 30 % of loss at one jitter, the dashed one is the law on board."""
    figure = Figure(figsize=(TEXT_WIDTH_IN, 3.2), layout="constrained")
    experiments = list(dict.fromkeys(one.experiment for one in results))
    all_axes = figure.subplots(1, len(experiments), sharey=True, squeeze=False)[0]
    for axes, experiment in zip(all_axes, experiments, strict=True):
        for trigger, colour in zip(TRIGGERS, COLOURS, strict=False):
            here = [one for one in results if (one.trigger, one.experiment) == (trigger, experiment) and one.errors_m]
            _one_trigger(axes, here, colour)
        axes.set(title=experiment, xlabel="payload up (bytes/s)", xscale="log")
    all_axes[0].set_ylabel("error (cm)")
    all_axes[0].set_ylim(bottom=0.0)
    lines = [Line2D([], [], color=colour, label=name) for name, colour in zip(TRIGGERS, COLOURS, strict=False)]
    marks = [Line2D([], [], color="0.3", ls="", marker=mark, ms=4.0, label=name) for mark, name in _NAMES.items()]
    board = Line2D([], [], color="0.3", ls="--", label="on board")
    figure.legend(handles=[*lines, board, *marks], loc="outside upper center", ncols=4, title="trigger, and radio")
    return figure


def _one_trigger(axes: Axes, results: Sequence[Result], colour: str) -> None:
    for one in results:
        if not one.radio:
            axes.axhline(100.0 * float(np.mean(one.errors_m)), color=colour, ls="--", lw=0.8)
    for words, mark in _MARKS.items():
        mine = [one for one in results if one.link is not None and _words_of(one.radio) == words]
        x = [one.link.uplink_bytes_per_s for one in mine if one.link is not None]
        axes.plot(x, [100.0 * np.mean(one.errors_m) for one in mine], "-", marker=mark, ms=4.0, color=colour)


def _words_of(radio: str) -> str:
    return next(words for words in _MARKS if words in radio)
