"""Figures of one experiment as in the paper: positions, force inputs, network, triggers, V(t).

They are as wide as both columns of a paper, in its font size.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.analysis.report.charts import (
    AXES,
    COLOURS,
    TEXT_WIDTH_IN,
    Medium,
    at_least_wide,
    histogram,
    legend_above,
    style_of,
    symmetric,
)
from companion.arms.model import CHAIN, JOINTS_PER_ARM, KINDS
from companion.core.paper_vehicle import GRAVITY_MPS2
from companion.core.types import Array
from companion.studies.paper.campaign import label_of, scene_of, tracking
from companion.studies.paper.campaign_detail import Detail, Proof

Drawn = tuple[str, str, Path]
"""Subject, caption, and PNG file; a PDF of the same name lies beside it."""

_LAWS = (COLOURS[1], COLOURS[0], *COLOURS[2:])
"""Colours of the laws; the baseline has the first."""
_MOST_STEMS = 500
"""Gaps up to which each is drawn with a line down to the axis."""


def draw_experiment(details: Sequence[Detail], folder: Path) -> list[Drawn]:
    """Draw all figures of one experiment's flights, the baseline first; lost vehicles would hide the others."""
    with style_of(Medium.PAPER):
        return _draw_all(details, folder)


def _draw_all(details: Sequence[Detail], folder: Path) -> list[Drawn]:
    left_out = "".join(f" {label_of(one.item.controller)} was lost and is left out." for one in details if one.lost)
    details = [detail for detail in details if not detail.lost] or details[:1]
    experiment = label_of(details[0].item.experiment)
    thinking = [detail for detail in details if "f_hat" in detail.signals]
    triggered = [detail for detail in details if not detail.trace.event.all()]
    proved = [(detail, detail.proof) for detail in details if detail.proof is not None]
    figures: list[tuple[str, str, Figure]] = [
        ("flown", "Flight plan: the reference from above, its speed, and the arms' joints.", _flown(details[0])),
        ("position", f"Position and error. The reference is dashed.{left_out}", _positions(details)),
        ("force", "Force inputs U_c = m_t (u + g e_3), held between triggers.", _forces(details)),
    ]
    if thinking:
        figures.append(("network", _NETWORK, _networks(thinking)))
    if triggered:
        figures.append(("events", "Gaps between triggers, over time and as histograms.", _events(triggered)))
    if proved:
        figures.append(("lyapunov", "The Lyapunov function of eq. V-comp along the flight.", _lyapunov(proved)))
    return [
        _saved(figure, subject, caption, folder / f"{experiment}-{subject}") for subject, caption, figure in figures
    ]


_NETWORK = (
    "Output of the network, true friction at the reference velocity (which it should learn), the same with the room's "
    "disturbance, and the output of the disturbance observer if the law has one."
)


def _saved(figure: Figure, subject: str, caption: str, stem: Path) -> Drawn:
    figure.savefig(stem.with_suffix(".png"), dpi=200)
    figure.set_layout_engine("none")  # laid out already, and that takes longer than the drawing
    figure.savefig(stem.with_suffix(".pdf"))
    return subject, caption, stem.with_suffix(".png")


def _stacked_axes(figure: Figure, columns: int, labels: Sequence[str]) -> list[list[Axes]]:
    """Return rows of axes with these labels, and time below."""
    rows: list[list[Axes]] = figure.subplots(len(labels), columns, sharex=True, squeeze=False).tolist()
    for row, label in zip(rows, labels, strict=True):
        row[0].set_ylabel(label)
    for axes in rows[-1]:
        axes.set_xlabel("time (s)")
    return rows


def _each_law(details: Sequence[Detail], draw: Callable[[Detail, str, str], None]) -> None:
    """Call `draw(detail, colour, name)` for every law; the baseline, the first, has one colour in every figure."""
    for detail in details:
        colour = _LAWS[0] if detail is details[0] else _LAWS[1 + (details.index(detail) - 1) % (len(_LAWS) - 1)]
        draw(detail, colour, label_of(detail.item.controller))


def _positions(details: Sequence[Detail]) -> Figure:
    figure = Figure(figsize=(TEXT_WIDTH_IN, 4.6), layout="constrained")
    rows = _stacked_axes(figure, 2, [f"{axis} (m)" for axis in AXES])
    now = tracking(details[0].trace)
    time = details[0].trace.time_s[now]

    def draw(detail: Detail, colour: str, name: str) -> None:
        for axis, (left, right) in enumerate(rows):
            left.plot(time, detail.trace.position_w_m[now, axis], color=colour, label=name)
            right.plot(time, 100.0 * detail.trace.error_w_m[now, axis], color=colour)

    _each_law(details, draw)
    for axis, (left, right) in enumerate(rows):
        left.plot(time, details[0].trace.reference_w_m[now, axis], "k--", lw=1.0, label="reference")
        right.axhline(0.0, color="k", lw=0.5)
        right.set_ylabel(f"{AXES[axis]} error (cm)")
        at_least_wide(left, 0.1)
    legend_above(figure, rows[0][0])
    return figure


def _forces(details: Sequence[Detail]) -> Figure:
    """Draw a column for each law: the baseline's command changes every cycle and would hide the others."""
    figure = Figure(figsize=(TEXT_WIDTH_IN, 4.2), layout="constrained")
    rows = _stacked_axes(figure, len(details), [f"$U_{{c{axis}}}$ (N)" for axis in AXES])
    now = tracking(details[0].trace)
    place = iter(range(len(details)))

    def draw(detail: Detail, colour: str, name: str) -> None:
        column = next(place)
        force_n = detail.mass_kg * (detail.trace.accel_w_mps2[now] + np.array([0.0, 0.0, GRAVITY_MPS2]))
        rows[0][column].set_title(name)
        for axis, row in enumerate(rows):
            row[column].step(detail.trace.time_s[now], force_n[:, axis], where="post", color=colour, lw=0.8)

    _each_law(details, draw)
    for row in rows:
        symmetric(row)
    return figure


def _networks(details: Sequence[Detail]) -> Figure:
    figure = Figure(figsize=(TEXT_WIDTH_IN, 4.4), layout="constrained")
    rows = _stacked_axes(figure, len(details), [f"{axis} (m/s²)" for axis in AXES])
    for column, detail in enumerate(details):
        now, signals = tracking(detail.trace), detail.signals
        time = detail.trace.time_s[now]
        rows[0][column].set_title(label_of(detail.item.controller))
        both = detail.friction_w_mps2 + detail.room_w_mps2
        for axis, row in enumerate(rows):
            axes = row[column]
            axes.plot(time, both[now, axis], color="0.75", lw=1.0, label="friction and disturbance")
            axes.plot(time, detail.friction_w_mps2[now, axis], "k--", lw=1.0, label="true friction, $f_d$")
            if "push" in signals and signals["push"].any():
                axes.plot(time, signals["push"][now, axis], color=_LAWS[2], lw=1.0, label="disturbance observer")
            axes.plot(time, signals["f_hat"][now, axis], color=_LAWS[1], lw=1.2, label=r"network, $\hat f_d$")
    legend_above(figure, max(rows[0], key=lambda axes: len(axes.get_legend_handles_labels()[1])))
    return figure


def _events(details: Sequence[Detail]) -> Figure:
    figure = Figure(figsize=(TEXT_WIDTH_IN, 0.2 + 1.7 * len(details)), layout="constrained")
    rows = figure.subplots(len(details), 2, squeeze=False, width_ratios=(3.0, 1.0))
    longest_ms = max(_gaps_ms(detail)[1].max(initial=20.0) for detail in details)
    for detail, (over_time, counted) in zip(details, rows, strict=True):
        time, gap_ms = _gaps_ms(detail)
        if len(time) <= _MOST_STEMS:
            over_time.vlines(time, 0.0, gap_ms, color=COLOURS[0], lw=0.5)
        over_time.plot(time, gap_ms, ".", color=COLOURS[0], ms=2.0)
        over_time.set(title=label_of(detail.item.controller), ylabel="gap (ms)", ylim=(0.0, None))
        histogram(counted, gap_ms, np.arange(5.0, longest_ms + 10.0, 10.0).tolist())
        counted.set(ylabel="triggers", xlim=(0.0, longest_ms + 10.0))
    rows[-1][0].set_xlabel("time (s)")
    rows[-1][1].set_xlabel("gap (ms)")
    return figure


def _gaps_ms(detail: Detail) -> tuple[Array, Array]:
    time = detail.trace.time_s[tracking(detail.trace) & detail.trace.event]
    return time[1:], np.diff(time) * 1e3


def _lyapunov(proved: Sequence[tuple[Detail, Proof]]) -> Figure:
    figure = Figure(figsize=(TEXT_WIDTH_IN, 2.7), layout="constrained")
    row = figure.subplots(1, len(proved), squeeze=False, sharey=True)[0]
    for axes, (detail, proof) in zip(row, proved, strict=True):
        v, time = proof.lyapunov, detail.trace.time_s
        axes.semilogy(time, v.total, "0.7", lw=2.6, label="V")
        axes.semilogy(time, v.states, color=_LAWS[1], lw=0.9, label="states")
        axes.semilogy(time, v.weights0 + v.weights1, color=_LAWS[2], lw=0.9, label="weights")
        if proof.bound.applies:
            axes.axhline(proof.bound.v_bound, color=_LAWS[0], ls=":", label="fixed-time bound")
        axes.axvline(0.0, color="0.6", lw=0.8, ls="--")
        axes.set(xlabel="time (s); the trajectory begins at 0", title=label_of(detail.item.controller))
    row[0].set_ylabel("V")
    legend_above(figure, max(row, key=lambda axes: len(axes.get_legend_handles_labels()[1])))
    return figure


def _flown(detail: Detail) -> Figure:
    figure = Figure(figsize=(TEXT_WIDTH_IN, 3.2), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.0, 1.3))[0]
    trace, now = detail.trace, tracking(detail.trace)
    above = left.subplots()
    path = trace.reference_w_m[now]
    above.plot(path[:, 0], path[:, 1], "k", lw=1.0, label="reference")
    above.plot(*path[0, :2], "ko", ms=5, label="start")
    begun, going = (path[len(path) * share // 100, :2] for share in (11, 12))
    above.annotate("", going, begun, arrowprops={"arrowstyle": "->", "mutation_scale": 18.0})
    above.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", adjustable="box")
    above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    scene = scene_of(detail.item)
    panels: list[Axes] = right.subplots(1 if scene.arms is None else 2, 1, sharex=True, squeeze=False)[:, 0].tolist()
    speed, arms = panels[0], panels[1:]
    speed.plot(trace.time_s, np.sqrt((trace.reference_velocity_w_mps**2).sum(axis=-1)), "k", lw=1.1)
    speed.set_ylabel("speed (m/s)")
    for axes in arms:
        assert scene.arms is not None
        _joints(axes, trace.time_s, scene.arms.trajectory.at(trace.time_s + scene.settle_s).position_rad)
    panels[-1].set_xlabel("time (s); the trajectory begins at 0")
    return figure


def _joints(axes: Axes, time: Array, joints_rad: Array) -> None:
    for first, style in ((0, "-"), (JOINTS_PER_ARM, "--")):
        for joint in range(CHAIN):
            name = KINDS[joint].replace("_", " ") if first == 0 else None
            degrees = np.degrees(joints_rad[:, first + joint])
            axes.plot(time, degrees, style, color=COLOURS[joint], label=name)
    axes.set_ylabel("joints (°)\nleft dashed")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=CHAIN)
