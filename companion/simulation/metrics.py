"""Metrics of a virtual flight: errors, updates, divergence. Broadcasts over the batch. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array, Mask
from companion.simulation.simulation import Trace

LOST_M = 2.0
"""Distance from the reference at which a vehicle has diverged, as one whose position is NaN."""


@dataclass(frozen=True)
class Score:
    """Metrics of each vehicle of a batch (...,); errors per axis of W, (..., 3)."""

    mean_error_m: Array
    max_error_m: Array
    update_share: Array
    event_share: Array
    """Share of the cycles in which the law's trigger fired; the rate limits may send more on the way to a setpoint."""
    diverged: NDArray[np.bool_]
    landed: NDArray[np.bool_]
    """Landed by PX4, as the law on the ground was not heard for too long; the other numbers count until then."""

    @property
    def error_m(self) -> Array:
        """Norm of the means of the three axes (m), (...,)."""
        return np.asarray(np.sqrt((self.mean_error_m**2).sum(axis=-1)))


def score(trace: Trace, from_s: float = 0.0) -> Score:
    """Return the metrics of the cycles from `from_s` on, divergence of all; errors may be infinite after it.

    They are NaN for a vehicle that PX4 has landed before.
    """
    if trace.flown is not None:
        return _score_of_parts(trace, trace.flown, from_s)
    begin = int((trace.time_s < from_s - 1e-9).sum())
    error = np.abs(trace.error_w_m)
    far = np.sqrt(np.vecdot(error, error).max(axis=0))
    return Score(
        error[begin:].mean(axis=0),
        error[begin:].max(axis=0),
        trace.sent[begin:].mean(axis=0),
        trace.event[begin:].mean(axis=0),
        ~(far <= LOST_M),
        np.zeros(far.shape, dtype=bool),
    )


def _score_of_parts(trace: Trace, flown: Mask, from_s: float) -> Score:
    """Return the metrics of flights that end at different times, where the mask (n, ...) does."""
    counted = flown & (trace.time_s >= from_s - 1e-9).reshape(-1, *(1,) * (flown.ndim - 1))
    error = np.abs(trace.error_w_m)
    far = np.where(flown, np.sqrt((error**2).sum(axis=-1)), 0.0).max(axis=0)
    cycles = counted.sum(axis=0)
    none = np.where(cycles > 0, 0.0, np.nan)

    def mean(values: Array | Mask) -> Array:
        inside = counted.reshape(counted.shape + (1,) * (values.ndim - counted.ndim))
        many = np.maximum(cycles, 1).reshape(cycles.shape + (1,) * (values.ndim - counted.ndim))
        return np.asarray(np.where(inside, values, 0.0).sum(axis=0) / many)

    largest = np.where(counted[..., None], error, 0.0).max(axis=0)
    return Score(
        mean(error) + none[..., None],
        largest + none[..., None],
        mean(trace.sent) + none,
        mean(trace.event) + none,
        ~(far <= LOST_M),
        ~flown[-1],
    )
