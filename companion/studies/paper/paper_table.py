"""The paper's table of position errors (tab:error), and how a reduction is counted."""

from dataclasses import dataclass

import numpy as np

from companion.core.types import Array

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class PaperRow:
    """Errors of one method on one experiment, per axis of W (m)."""

    mean_m: Triple
    max_m: Triple


@dataclass(frozen=True)
class PaperExperiment:
    """One experiment's columns, and the reductions as printed (per cent)."""

    etnn: PaperRow
    pid: PaperRow
    mean_reduced_percent: Triple
    max_reduced_percent: Triple


PAPER = {
    "ellipse": PaperExperiment(
        PaperRow((0.0172, 0.0316, 0.0378), (0.0663, 0.1672, 0.1151)),
        PaperRow((0.0841, 0.0773, 0.0430), (0.2383, 0.2510, 0.1464)),
        (79.57, 59.08, 12.09),
        (72.18, 33.52, 21.39),
    ),
    "figure8": PaperExperiment(
        PaperRow((0.0190, 0.0295, 0.0400), (0.0600, 0.0864, 0.1437)),
        PaperRow((0.0593, 0.0818, 0.0673), (0.1876, 0.2690, 0.2035)),
        (68.00, 63.96, 40.52),
        (68.20, 67.88, 29.39),
    ),
}
"""By the name of the experiment's file."""

PID_WITHIN = 0.2
"""Largest difference of the baseline's mean errors from the paper's for the reductions to be comparable."""


def reduced_percent(error_m: Array, baseline_m: Array) -> Array:
    """Return the reduction of an error against the baseline's, per cent of the latter, axis by axis (...,)."""
    return np.asarray(100.0 * (1.0 - np.asarray(error_m) / np.asarray(baseline_m)))


def beside_paper(pid_mean_m: Array, paper: PaperExperiment) -> Array:
    """Our baseline's mean errors (3,) over the paper's, less one: 0 is the same, 0.2 a fifth more."""
    return np.asarray(np.asarray(pid_mean_m) / np.array(paper.pid.mean_m) - 1.0)
