"""Pictures of the arms: poses from the side and from behind, with what they must not touch.

`python -m companion.studies.paper.arm_plots docs/images/arm-poses.png` draws the one in the documentation.
"""

import sys
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from companion.arms.collision import clearance
from companion.arms.dynamics import link_com_flu_m
from companion.arms.kinematics import points_flu_m
from companion.arms.model import SIDES, ArmModel
from companion.config.arms_config import ArmsConfig
from companion.core.types import Array

mpl.use("Agg")  # pictures are files; no display is wanted or needed

_SIDE, _REAR = (0, 2), (1, 2)
"""Axes of FLU that a view shows: x and z, y and z."""
_COLOURS = {"right": "#d55e00", "left": "#0072b2"}
_LINKS = ("$L_1$", "$L_2$", "$L_3$")


def plot_poses(model: ArmModel, poses: Mapping[str, Array], path: Path) -> None:
    """One column a pose (8,), side view above rear view; written as PNG (or by suffix)."""
    figure = Figure(figsize=(4.2 * len(poses), 6.6), layout="constrained")
    rows = figure.subplots(2, len(poses), squeeze=False)
    for (name, joints_rad), side, rear in zip(poses.items(), *rows, strict=True):
        near = clearance(model, joints_rad)
        side.set_title(f"{name}\nnearest: {near.what}, {near.distance_m:.3f} m", fontsize=9)
        for axes, view in ((side, _SIDE), (rear, _REAR)):
            _surroundings(axes, model, view)
            _arms(axes, model, joints_rad, view)
            axes.set(aspect="equal", xlim=(-0.55, 0.55), ylim=(-0.55, 0.2), xlabel=f"body {'xyz'[view[0]]} (m)")
            axes.grid(alpha=0.3)
        rear.set_xlim(0.55, -0.55)  # seen from behind: left is left
    for axes, kind in zip(rows[:, 0], ("from the left", "from behind"), strict=True):
        axes.set_ylabel(f"{kind}\nbody z (m)")
    _senses(rows[0, 0], rows[1, 0], model)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def _surroundings(axes: Axes, model: ArmModel, view: tuple[int, int]) -> None:
    half = np.array(model.body_half_flu_m)[list(view)]
    axes.add_patch(Rectangle((-half[0], -half[1]), *(2.0 * half), color="0.8", zorder=1))
    propellers = model.propellers
    for number in range(propellers.count):
        angle = propellers.first_rad + 2.0 * np.pi * number / propellers.count
        middle = propellers.centre_m * (np.cos(angle), np.sin(angle))[view[0]]
        ends = (middle - propellers.radius_m, middle + propellers.radius_m)
        axes.plot(ends, (propellers.height_m,) * 2, color="0.35", lw=2.0, zorder=2)


def _arms(axes: Axes, model: ArmModel, joints_rad: Array, view: tuple[int, int]) -> None:
    points, centres = points_flu_m(model, joints_rad)[..., view], link_com_flu_m(model, joints_rad)[..., view]
    for side, arm, masses in zip(SIDES, points, centres, strict=True):
        colour = _COLOURS[side]
        for start, end in pairwise(arm):
            along = end - start
            across = np.array((-along[1], along[0])) / max(float(np.hypot(*along)), 1e-9) * model.link_radius_m
            outline = np.stack((start + across, end + across, end - across, start - across))
            axes.fill(*outline.T, color=colour, alpha=0.2, lw=0.0, zorder=3)
        for point in arm:
            axes.add_patch(Circle((point[0], point[1]), model.link_radius_m, color=colour, alpha=0.2, lw=0.0, zorder=3))
        axes.plot(*arm.T, "o-", color=colour, lw=1.8, ms=4.0, label=str(side), zorder=4)
        axes.plot(*masses.T, "x", color="k", ms=5.0, zorder=5)


def _senses(side: Axes, rear: Axes, model: ArmModel) -> None:
    """Names of the links and the positive senses, beside the arms of the first column."""
    right, left = points_flu_m(model, np.zeros(8))
    for axes, view, beside in ((side, _SIDE, -0.09), (rear, _REAR, -0.06)):
        for name, start, end in zip(_LINKS, left[:-1], left[1:], strict=True):
            middle = 0.5 * (start + end)[list(view)]
            axes.text(middle[0] + beside, middle[1], name, va="center", ha="center", fontsize=9)
    for place, name in ((0, "shoulder pitch"), (1, "elbow pitch")):
        _arrow(side, left[place][list(_SIDE)], 1.0, f"+ {name}")
    _arrow(rear, left[2][list(_REAR)], 1.0, "+ elbow roll")
    _arrow(rear, right[2][list(_REAR)], -1.0, "")
    side.legend(loc="upper left", fontsize=8)


def _arrow(axes: Axes, about: Array, sense: float, words: str) -> None:
    """A quarter turn below a joint, towards where its angle grows."""
    low, high = about - np.array((0.0, 0.1)), about + np.array((0.1 * sense, 0.0))
    bow = "arc3,rad=" + ("0.4" if axes.get_xlim()[0] < 0.0 else str(-0.4 * sense))
    axes.add_patch(FancyArrowPatch(low, high, connectionstyle=bow, arrowstyle="->", mutation_scale=12, color="0.2"))
    outside = "left" if axes.get_xlim()[0] < 0.0 else "right"
    axes.text(high[0] + 0.02 * sense, high[1], words, fontsize=8, va="center", ha=outside)


if __name__ == "__main__":
    arms = ArmsConfig()
    named = {"all zero": (0.0, 0.0, 0.0), "home": arms.poses.home_rad, "stow": arms.poses.stow_rad}
    plot_poses(arms.model(), {name: np.array([*pose, 0.0] * 2) for name, pose in named.items()}, Path(sys.argv[1]))
