"""Pictures of a recorded flight."""

from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.analysis.summary import Columns, Summary, tracking_error_w_m
from companion.arms.model import JOINTS_PER_ARM, KINDS
from companion.core.types import Array
from companion.supervisor.flight_state import Phase

mpl.use("Agg")  # pictures are files; no display is wanted or needed

_AXES = ("x", "y", "z")
_COLOURS = ("#0072b2", "#d55e00", "#009e73")  # told apart by colour-blind readers, too
_PHASE_SHADES = {"takeoff": "#e8f1fa", "hold": "#f7f7f7", "track": "#fff3d9", "stow": "#e9f5ec", "land": "#f5e6f0"}


def plot_flight(columns: Columns, summary: Summary | None, title: str, path: Path) -> None:
    """Write one page: path from above, position and error over time, thrust and updates; format by suffix."""
    panels = [_positions, _errors, _setpoints, _updates, *([_arms] if "joint_position_rad" in columns else [])]
    figure = Figure(figsize=(12.0, 2.0 * len(panels)), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.0, 1.35))[0]
    above, words = left.subplots(2, 1, height_ratios=(len(panels) - 1, 1))
    time = _since_takeoff(columns)
    _from_above(above, columns)
    _words(words, summary)
    for row, (axes, panel) in enumerate(zip(right.subplots(len(panels), 1), panels, strict=True)):
        panel(axes, time, columns)
        _shade_phases(axes, time, columns)
        axes.set_xlim(max(time[0], -2.0), time[-1])
        axes.grid(alpha=0.3)
        if row == 0:
            _name_phases(axes, time, columns)
        axes.tick_params(labelbottom=row == len(panels) - 1)
    axes.set_xlabel("time since takeoff (s)")
    figure.suptitle(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def _floats(columns: Columns, name: str) -> Array:
    return np.asarray(columns[name], dtype=np.float64)


def _since_takeoff(columns: Columns) -> Array:
    time = _floats(columns, "time_s")
    flying = np.flatnonzero(columns["phase"] == str(Phase.TAKEOFF))
    return np.asarray(time - time[flying[0] if flying.size else 0])


def _from_above(axes: Axes, columns: Columns) -> None:
    flown, wanted = _floats(columns, "position_w_m"), _floats(columns, "reference_position_w_m")
    tracking = columns["phase"] == str(Phase.TRACK)
    axes.plot(flown[:, 0], flown[:, 1], color="0.75", lw=1.0, label="way there and back")
    axes.plot(wanted[tracking, 0], wanted[tracking, 1], "k--", lw=1.2, label="reference")
    axes.plot(flown[tracking, 0], flown[tracking, 1], color=_COLOURS[0], lw=1.6, label="flown")
    axes.set(xlabel="x (m)", ylabel="y (m)", title="from above", aspect="equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left", fontsize=8)


def _words(axes: Axes, summary: Summary | None) -> None:
    axes.axis("off")
    if summary is None:
        axes.text(0.0, 0.9, "no trajectory was tracked", va="top", family="monospace", fontsize=10)
        return
    rows = [
        "error (cm)       x       y       z",
        *(
            f"{name:<10}" + "".join(f" {100.0 * value:7.2f}" for value in values)
            for name, values in (
                ("mean", summary.mean_error_m),
                ("rms", summary.rms_error_m),
                ("max", summary.max_error_m),
            )
        ),
        f"updates in {summary.update_share:.1%} of {summary.control_cycles} cycles",
    ]
    axes.text(0.0, 0.95, "\n".join(rows), va="top", family="monospace", fontsize=10)


def _positions(axes: Axes, time: Array, columns: Columns) -> None:
    flown, wanted = _floats(columns, "position_w_m"), _floats(columns, "reference_position_w_m")
    for axis, (name, colour) in enumerate(zip(_AXES, _COLOURS, strict=True)):
        axes.plot(time, flown[:, axis], color=colour, lw=1.3, label=name)
        axes.plot(time, wanted[:, axis], "--", color=colour, lw=0.8, alpha=0.8)
    axes.set_ylabel("position (m)")
    axes.legend(loc="lower left", fontsize=8)


def _errors(axes: Axes, time: Array, columns: Columns) -> None:
    below_the_floor = _floats(columns, "reference_position_w_m")[:, 2:] < 0.0  # the last moment of a landing
    error = np.where(below_the_floor, np.nan, tracking_error_w_m(columns))
    for axis, colour in enumerate(_COLOURS):
        axes.plot(time, error[:, axis], color=colour, lw=1.0)
    axes.axhline(0.0, color="k", lw=0.5)
    axes.set_ylabel("error (m)")


def _setpoints(axes: Axes, time: Array, columns: Columns) -> None:
    wanted = _floats(columns, "accel_w_mps2")
    for axis, colour in enumerate(_COLOURS):
        axes.plot(time, wanted[:, axis], color=colour, lw=0.8)
    axes.set_ylabel("command u (m/s²)")


def _updates(axes: Axes, time: Array, columns: Columns) -> None:
    sent = time[np.asarray(columns["event"], dtype=bool)]
    if sent.size > 1:
        gap_ms = np.diff(sent) * 1e3
        axes.plot(sent[1:], gap_ms, ".", ms=2.5, color="0.25")
        axes.set_yscale("log")
    axes.set_ylabel("gap between\nupdates (ms)")


def _arms(axes: Axes, time: Array, columns: Columns) -> None:
    """Draw the pitches and rolls in degrees: right arm solid, left arm dashed."""
    joints = np.degrees(_floats(columns, "joint_position_rad"))
    for first, style in ((0, "-"), (JOINTS_PER_ARM, "--")):
        for joint, colour in enumerate(_COLOURS):
            name = KINDS[joint].replace("_", " ") if first == 0 else None
            axes.plot(time, joints[:, first + joint], style, color=colour, lw=0.9, label=name)
    axes.set_ylabel("joints (°)\nleft dashed")
    axes.legend(loc="upper left", fontsize=8)


def _stretches(columns: Columns) -> list[tuple[int, int, str]]:
    """Return first row, last row and name of every phase."""
    phase = columns["phase"]
    edges = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1), len(phase) - 1]
    return [(begin, end, str(phase[begin])) for begin, end in pairwise(edges)]


def _shade_phases(axes: Axes, time: Array, columns: Columns) -> None:
    for begin, end, phase in _stretches(columns):
        if phase in _PHASE_SHADES:
            axes.axvspan(time[begin], time[end], color=_PHASE_SHADES[phase], zorder=0)


def _name_phases(axes: Axes, time: Array, columns: Columns) -> None:
    """Write the names above the topmost panel, where there is room for the word."""
    room_s = 0.05 * (time[-1] - time[0])
    for begin, end, phase in _stretches(columns):
        if phase in _PHASE_SHADES and time[end] - time[begin] > room_s:
            middle = 0.5 * (time[begin] + time[end])
            axes.text(
                middle,
                1.02,
                phase,
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=8,
                color="0.35",
            )
