"""What a virtual flight is judged by: errors, updates, divergence. Broadcasts over the batch. Pure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array
from companion.simulation.simulation import Trace

LOST_M = 2.0
"""A vehicle that was ever so far from its reference, or whose position is no number, has diverged."""


@dataclass(frozen=True)
class Score:
    """Of each vehicle of a batch (...,); errors per axis of W, (..., 3)."""

    mean_error_m: Array
    max_error_m: Array
    update_share: Array
    """Share of the cycles that sent a setpoint."""
    event_share: Array
    """Share of the cycles in which the law's trigger fired; the gate may send some more on the way to a setpoint."""
    diverged: NDArray[np.bool_]

    @property
    def error_m(self) -> Array:
        """Norm of the three axes' means, (...,)."""
        return np.asarray(np.sqrt((self.mean_error_m**2).sum(axis=-1)))


def score(trace: Trace, from_s: float = 0.0) -> Score:
    """Over the cycles from `from_s` on; divergence over all of them. A diverged vehicle's errors may be infinite."""
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
