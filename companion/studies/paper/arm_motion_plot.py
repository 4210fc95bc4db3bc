"""A picture of a planned motion of the arms."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from companion.arms.model import JOINTS_PER_ARM, KINDS, SIDES, ArmModel
from companion.studies.paper.arm_motion import MotionNumbers

mpl.use("Agg")  # pictures are files; no display is wanted or needed

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")  # told apart by colour-blind readers, too


def plot_motion(model: ArmModel, numbers: MotionNumbers, approach_s: float, title: str, path: Path) -> None:
    """Joint angles of each arm, and the clearance, over time. PNG, or by suffix.

    The way to the motion's own start, `approach_s` long, is shaded. Raises OSError when `path` cannot be written.
    """
    figure = Figure(figsize=(10.0, 8.0), layout="constrained")
    panels = figure.subplots(len(SIDES) + 1, 1, sharex=True)
    for arm, side in enumerate(SIDES):
        _angles(panels[arm], numbers, arm)
        panels[arm].set_ylabel(f"{side} arm (deg)")
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(KINDS), fontsize=8, frameon=False)
    _clearance(panels[-1], model, numbers)
    for axes in panels:
        axes.grid(alpha=0.3)
        if approach_s > 0.0:
            axes.axvspan(0.0, approach_s, color="#f0f0f0", zorder=0)
    if approach_s > 0.0:
        panels[-1].text(0.0, 0.03, " way to its start", transform=panels[-1].get_xaxis_transform(), fontsize=8)
    panels[-1].set_xlabel("time (s)")
    panels[-1].set_xlim(0.0, numbers.duration_s)
    figure.suptitle(f"{title}, {numbers.duration_s:.1f} s", x=0.01, ha="left")
    figure.savefig(path, dpi=110)


def _angles(axes: Axes, numbers: MotionNumbers, arm: int) -> None:
    for joint, (kind, colour) in enumerate(zip(KINDS, _COLOURS, strict=True)):
        angle_rad = numbers.motion.position_rad[:, arm * JOINTS_PER_ARM + joint]
        axes.plot(numbers.time_s, np.degrees(angle_rad), color=colour, lw=1.5, label=kind.replace("_", " "))


def _clearance(axes: Axes, model: ArmModel, numbers: MotionNumbers) -> None:
    axes.plot(numbers.clearance_time_s, 1e3 * numbers.clearance_m, color="k", lw=1.5)
    axes.axhline(1e3 * model.margin_m, color="#d55e00", ls="--", lw=1.0)
    axes.text(
        numbers.duration_s, 1e3 * model.margin_m, "to be kept ", color="#d55e00", ha="right", va="bottom", fontsize=8
    )
    near = numbers.nearest
    axes.plot(near.time_s, 1e3 * near.distance_m, "o", color="k", ms=5, clip_on=False)
    axes.set_title(
        f"nearest: {near.what}, {1e3 * near.distance_m:.0f} mm at {near.time_s:.1f} s", loc="left", fontsize=9
    )
    axes.set_ylabel("clearance (mm)")
    axes.set_ylim(min(0.0, 1.1e3 * near.distance_m), 1.08e3 * float(numbers.clearance_m.max()))
