"""Trajectories of a flight, from phases and commands. Pure."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array
from companion.records.table import RecordedEvent

Mask = NDArray[np.bool_]
LEAST_CYCLES = 10
"""Least number of cycles of a trajectory: a goto ends with one cycle of phase track."""
UNNAMED = "trajectory"


@dataclass(frozen=True)
class Trajectory:
    """One trajectory, from its first cycle to its last."""

    name: str
    """Name by which it was commanded: ellipse, figure8, waypoints; `trajectory` where the record does not say."""
    law: str
    """Law in charge; several are separated by commas."""
    begin_s: float
    """Time since lift-off."""
    end_s: float
    mask: Mask
    """Cycles of the trajectory, (n,)."""


def runs(among: Mask, tick: Array) -> NDArray[np.int_]:
    """Number the runs of consecutive cycles, (n,); -1 for cycles that are not `among`."""
    begins = among.copy()
    begins[1:] &= ~among[:-1] | (np.diff(tick) > 1.0)
    return np.where(among, np.cumsum(begins) - 1, -1)


def trajectory_name(events: Sequence[RecordedEvent], begin_s: float, otherwise: str) -> str:
    """Return the name of the last command before `begin_s`, the service's time; empty for a goto."""
    for event in sorted(events, key=lambda event: event.time_s, reverse=True):
        if event.kind != "command" or event.time_s > begin_s:
            continue
        verb, _, rest = event.text.partition(" ")
        if verb == "goto":
            return ""
        if verb == "track":
            curve = re.search(r"\bcurve=(\w+)", rest)
            return curve[1] if curve else "waypoints"
    return otherwise


def law_label(name: str) -> str:
    """Return a law's name without the folder that its file was in."""
    return PurePath(name).name if "/" in name else name
