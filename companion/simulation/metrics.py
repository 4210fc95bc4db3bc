"""Metrics of a virtual flight: errors, updates, divergence. Broadcasts over the batch. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array
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

    @property
    def error_m(self) -> Array:
        """Norm of the means of the three axes (m), (...,)."""
        return np.asarray(np.sqrt((self.mean_error_m**2).sum(axis=-1)))


def score(trace: Trace, from_s: float = 0.0) -> Score:
    """Return the metrics of the cycles from `from_s` on, divergence of all; errors may be infinite after it."""
    counted = trace.time_s >= from_s - 1e-9
    error = np.abs(trace.error_w_m)
    far = np.sqrt((error**2).sum(axis=-1)).max(axis=0)
    return Score(
        error[counted].mean(axis=0),
        error[counted].max(axis=0),
        trace.sent[counted].mean(axis=0),
        trace.event[counted].mean(axis=0),
        ~(far <= LOST_M),
    )
