"""Numbers of a sweep: errors by nominal bandwidth, and the parameters they depend on. Pure."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array
from companion.studies.sweep.sweep import ERROR, Columns

PARAMETERS = {
    "mass_kg": "mass (kg)",
    "hover_thrust": "hover thrust",
    "bandwidth_radps": "attitude bandwidth (rad/s)",
    "mocap_delay_s": "mocap delay (s)",
    "setpoint_delay_s": "setpoint delay (s)",
    "disturbance_scale": "disturbance (×)",
    "offset_m": "start offset (m)",
    "noise_scale": "mocap noise (×)",
    "attitude_error_rad": "horizon error (rad)",
    "attitude_error_time_s": "horizon error time (s)",
    "unseen_s": "time not tracked (s)",
    "experiment": "experiment",
}
"""Columns that the errors may depend on, and their names."""
LINK_PARAMETERS = {
    "link_loss_share": "loss of the radio",
    "link_delay_s": "delay of the radio (s)",
    "link_jitter_s": "jitter of the radio (s)",
}
"""Those of a law on the ground as well."""

MOST_BINS = 10
_LEAST_IN_BIN = 10


@dataclass(frozen=True)
class Group:
    """Vehicles of one nominal bandwidth. An error is infinite where a diverged vehicle's would count."""

    vehicles: int
    diverged: int
    error_p50_m: float
    error_p95_m: float
    """95th percentile of the error over the vehicles."""
    error_max_m: float
    update_share: float
    """Mean over the vehicles."""


def parameters(columns: Columns) -> dict[str, str]:
    """Return the columns that the errors of a sweep may depend on, and their names."""
    return PARAMETERS | (LINK_PARAMETERS if "link_loss_share" in columns else {})


def errors_m(columns: Columns) -> Array:
    """Each vehicle's error (m), (N,); infinite if it diverged."""
    return np.where(columns["diverged"], math.inf, columns[ERROR])


def nominals(columns: Columns) -> list[float]:
    """The nominal bandwidths there are, rad/s, greatest first."""
    return [float(value) for value in np.unique(columns["nominal_radps"])[::-1]]


def of_nominal(columns: Columns, nominal_radps: float) -> Columns:
    """The rows of one nominal bandwidth."""
    rows = columns["nominal_radps"] == nominal_radps
    return {name: column[rows] for name, column in columns.items()}


def group(columns: Columns) -> Group:
    """Return the statistics of all these vehicles."""
    p50_m, p95_m, max_m = np.quantile(errors_m(columns), (0.5, 0.95, 1.0), method="inverted_cdf")
    lost = columns["diverged"]
    updates = float(columns["update_share"].mean())
    return Group(len(lost), int(lost.sum()), float(p50_m), float(p95_m), float(max_m), updates)


@dataclass(frozen=True)
class Blame:
    """Dependence of a vehicle's rank by error on one parameter alone."""

    parameter: str
    explained: float
    """Share of that rank's variance that the parameter explains, whatever the dependence's form; NaN if too few."""
    correlation: float
    """Spearman's rank correlation: positive where more of the parameter is worse; NaN if it does not vary."""


def blames(columns: Columns) -> list[Blame]:
    """Return the effect of every parameter, for vehicles of one nominal bandwidth."""
    place = ranks(errors_m(columns))
    found = []
    for name in parameters(columns):
        bins = binned(columns[name])
        found.append(Blame(name, explained(place, bins), correlation(place, ranks(columns[name]))))
    return found


def ranks(values: NDArray[Any]) -> Array:
    """Places 1..N in ascending order, (N,); equal values share their mean place."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - 0.5 * (counts - 1))[inverse])


def binned(values: NDArray[Any]) -> NDArray[np.int64]:
    """Return the bin of each value, (N,): one per value, or at most MOST_BINS about equally filled ones."""
    distinct, inverse = np.unique(values, return_inverse=True)
    count = max(min(MOST_BINS, len(values) // _LEAST_IN_BIN), 1)
    if len(distinct) <= count:
        return np.asarray(inverse, dtype=np.int64)
    return np.floor((ranks(values) - 0.5) * count / len(values)).astype(np.int64)


def explained(values: Array, bins: NDArray[np.int64]) -> float:
    """Share of the variance of `values` (N,) between the bins, less what chance alone would give; 0 at the least."""
    count, sizes = len(np.unique(bins)), np.bincount(bins)
    total = float(((values - values.mean()) ** 2).sum())
    if count < 2 or len(values) <= count or total == 0.0:
        return math.nan
    means = np.bincount(bins, values) / np.maximum(sizes, 1)
    within = float(((values - means[bins]) ** 2).sum())
    return max(0.0, 1.0 - (within / (len(values) - count)) / (total / (len(values) - 1)))


def correlation(a: Array, b: Array) -> float:
    """Return the rank correlation of two series (N,); NaN if one does not vary."""
    a, b = a - a.mean(), b - b.mean()
    scale = math.sqrt(float((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale > 0.0 else math.nan
