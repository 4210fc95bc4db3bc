"""When a new command is worth sending (paper, eq. ETC-law)."""

from dataclasses import dataclass

import numpy as np

from companion.control.gains import EtnnGains
from companion.control.switching import sign
from companion.types import Array


@dataclass(frozen=True)
class TriggerState:
    """u held since the last event (m/s^2), (..., 3); kappa, (..., 1); whether anything was sent yet, (..., 1)."""

    held: Array
    kappa: Array
    started: Array


def initial_trigger(gains: EtnnGains, lead: tuple[int, ...] = ()) -> TriggerState:
    """Nothing held: the first step is an event."""
    kappa = np.full((*lead, 1), gains.kappa_initial)
    return TriggerState(np.zeros((*lead, 3)), kappa, np.zeros((*lead, 1)))


def continuous_control(alpha2: Array, y2: Array, kappa: Array, gains: EtnnGains) -> Array:
    """u_bar = alpha_2 - (sigma + kappa/delta) sgn(y_2) (m/s^2), shape (..., 3)."""
    push = gains.sigma + kappa / gains.delta
    return np.asarray(alpha2 - gains.switching * push * sign(y2, gains.boundary_layer_mps))


def trigger_step(state: TriggerState, u_bar: Array, gains: EtnnGains, dt_s: float) -> tuple[TriggerState, Array, Array]:
    """Decide on an event and advance kappa; returns the new state, u (..., 3) and event (..., 1) as 0 or 1.

    The event takes effect before kappa is advanced, so |e_j| <= sigma + kappa/delta holds at every instant and kappa
    cannot become negative (for dt_s < delta / (1 + delta)).
    """
    error = np.abs(state.held - u_bar)
    worst = _over_axes(np.maximum, error)
    quiet = (state.kappa + gains.delta * (gains.sigma - worst) >= 0.0) & (state.started > 0.0)
    if gains.every_cycle:
        quiet = np.zeros_like(quiet)
    slack = gains.sigma - np.where(quiet, _over_axes(np.minimum, error), 0.0)  # the largest sigma - |e_j|
    kappa = state.kappa + dt_s * (slack - state.kappa)
    u = np.where(quiet, state.held, u_bar)
    return TriggerState(u, kappa, np.ones_like(kappa)), u, np.asarray(1.0 - quiet)


def _over_axes(pick: np.ufunc, vector: Array) -> Array:
    """Largest or smallest of the three components, shape (..., 1); a reduction over so few is slow in batches."""
    return np.asarray(pick(pick(vector[..., 0:1], vector[..., 1:2]), vector[..., 2:3]))
