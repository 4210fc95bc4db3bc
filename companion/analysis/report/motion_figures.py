"""Figures of the flight: path, errors, command, thrust, arms."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from companion.analysis.report.charts import (
    AXES,
    COLOURS,
    at_least_wide,
    free_only,
    legend_above,
    legend_of_axes,
    only,
    rows_over_time,
    thinned,
    xyz,
)
from companion.analysis.report.recorded_flight import Flown
from companion.arms.model import CHAIN, JOINTS_PER_ARM, KINDS
from companion.core.types import Array

REFERENCE: dict[str, Any] = {"color": "k", "ls": "--", "lw": 0.9}
GOAL: dict[str, Any] = {"color": "0.4", "lw": 2.6, "alpha": 0.35}
"""Style of references and goals over time, below the thin lines of what was measured."""
PALE: dict[str, Any] = {"color": "0.78", "lw": 0.9}


def above(figure: Figure, flown: Flown) -> None:
    """Draw the path in the x-y plane."""
    axes = figure.subplots()
    draw_above(axes, flown)
    legend_above(figure, axes)


def draw_above(axes: Axes, flown: Flown) -> None:
    """Draw the path in the x-y plane; if trajectories were flown, these, and the path between them pale."""
    where = flown.position_w_m
    shown = flown.tracked if flown.tracked.any() else flown.airborne
    for mask, values, label, how in (
        (flown.airborne, where, "between" if flown.tracked.any() else None, PALE),
        (shown, where, "flown", {"color": COLOURS[0]}),
        (shown, flown.reference_w_m, "reference", REFERENCE),
    ):
        path = only(mask, values)
        axes.plot(path[:, 0], path[:, 1], label=label, **how)
    axes.set(xlim=_limits(where[flown.airborne, 0]), ylim=_limits(where[flown.airborne, 1]))
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", adjustable="box")


def above_height_in(flown: Flown, width_in: float) -> float:
    """Return the height of `above`, inches, that leaves no white around a path of this shape."""
    where = flown.position_w_m[flown.airborne]
    (left, right), (low, high) = _limits(where[:, 0]), _limits(where[:, 1])
    height_in = (width_in - 0.75) * (high - low) / (right - left) + 0.85
    return float(np.clip(height_in, 0.52 * width_in, 1.02 * width_in))


def _limits(values: Array) -> tuple[float, float]:
    """Return the limits of an axis, wide enough that a hover looks like one, m."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = max(0.05 * (high - low), 0.25 - 0.5 * (high - low))
    return low - room, high + room


def space(figure: Figure, flown: Flown) -> None:
    """Draw the path in three dimensions."""
    axes = figure.add_subplot(projection="3d")
    shown = flown.tracked if flown.tracked.any() else flown.airborne
    where = flown.position_w_m
    axes.plot(*only(flown.airborne, where).T, **PALE)
    axes.plot(*only(shown, where).T, color=COLOURS[0])
    axes.plot(*only(shown, flown.reference_w_m).T, **REFERENCE)
    axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    spans = np.nan_to_num(np.nanmax(where[flown.airborne], axis=0) - np.nanmin(where[flown.airborne], axis=0))
    box = np.maximum(spans, 0.35 * max(float(spans.max()), 1e-3))
    axes.set_box_aspect(box.tolist(), zoom=1.0)
    for axis, share in zip((axes.xaxis, axes.yaxis, axes.zaxis), box / box.max(), strict=True):
        axis.set_major_locator(MaxNLocator(nbins=max(1, round(4.0 * share))))  # short axes have room for few numbers
    axes.view_init(elev=28.0, azim=-60.0)


def position(figure: Figure, flown: Flown) -> None:
    """Draw the position of each axis with its reference."""
    rows = rows_over_time(figure, [f"{axis} (m)" for axis in AXES], flown)
    time, where, reference = thinned(flown.time_s, flown.position_w_m, flown.reference_w_m)
    for axis, axes in enumerate(rows):
        axes.plot(time, reference[:, axis], **GOAL)
        axes.plot(time, where[:, axis], color=COLOURS[axis])
        at_least_wide(axes, 0.1)
    legend_of_axes(figure, reference=GOAL)


def errors(figure: Figure, flown: Flown) -> None:
    """Draw the errors of the axes, and their norm."""
    top, below = rows_over_time(figure, ["error (cm)", "norm (cm)"], flown)
    draw_errors(top, flown)
    time, size = thinned(flown.time_s, 100.0 * free_only(flown, flown.distance_m))
    below.plot(time, size, color="0.25")
    below.set_ylim(0.0, None)
    legend_above(figure, top)


def draw_errors(axes: Axes, flown: Flown) -> None:
    """Draw the errors of x, y and z in the air, cm."""
    xyz(axes, *thinned(flown.time_s, 100.0 * free_only(flown, flown.error_w_m)), labels=True)
    axes.axhline(0.0, color="k", lw=0.5)


def command(figure: Figure, flown: Flown) -> None:
    """Draw the law's command, which is held between its triggers."""
    rows = rows_over_time(figure, [f"$u_{axis}$ (m/s²)" for axis in AXES], flown)
    draw_command(rows, flown)


def draw_command(rows: Sequence[Axes], flown: Flown) -> None:
    """Draw the commands of x, y and z in the air, m/s^2, in three axes or in one."""
    number = flown.runs(flown.free)
    reference = flown.column("accel_w_mps2", 3)
    for stretch in range(int(number.max(initial=-1)) + 1):
        sent = (number == stretch) & flown.event & np.isfinite(reference).all(axis=1)
        for axis in range(3):
            axes = rows[axis % len(rows)]
            axes.step(flown.time_s[sent], reference[sent, axis], where="post", color=COLOURS[axis], lw=0.8)
    for axes in rows:
        at_least_wide(axes, 0.5)


def thrust(figure: Figure, flown: Flown) -> None:
    """Draw the thrust setpoints in the air and the battery voltage."""
    labels = ["thrust", *(["battery (V)"] if flown.has("battery_v") else [])]
    rows = rows_over_time(figure, labels, flown)
    time, value = thinned(flown.time_s, flown.column("setpoint_thrust"))
    rows[0].plot(time, value, color=COLOURS[0], lw=0.8)
    if np.isfinite(flown.column("setpoint_thrust")[flown.free]).any():
        in_air = flown.column("setpoint_thrust")[flown.free]
        rows[0].set_ylim(float(np.nanmin(in_air)) - 0.03, float(np.nanmax(in_air)) + 0.03)
    if len(rows) > 1:
        time, volts = thinned(flown.time_s, flown.column("battery_v"))
        rows[1].plot(time, volts, color=COLOURS[1])
        at_least_wide(rows[1], 0.2)


def arms(figure: Figure, flown: Flown) -> None:
    """Draw the joint positions and goals, a row for each arm."""
    rows = rows_over_time(figure, ["right arm (°)", "left arm (°)"], flown)
    draw_arms(rows, flown)
    legend_above(figure, rows[0], 4)


def draw_arms(rows: Sequence[Axes], flown: Flown) -> None:
    """Draw the joint positions and goals of the right and the left arm, degrees."""
    time, where, goal = thinned(
        flown.time_s, np.degrees(flown.column("joint_position_rad", 8)), np.degrees(flown.column("joint_goal_rad", 8))
    )
    for axes, first in zip(rows, (0, JOINTS_PER_ARM), strict=True):
        for joint in range(CHAIN):
            axes.plot(time, goal[:, first + joint], **GOAL | {"color": COLOURS[joint]})
            axes.plot(time, where[:, first + joint], color=COLOURS[joint], label=KINDS[joint].replace("_", " "), lw=0.9)
        at_least_wide(axes, 10.0)
