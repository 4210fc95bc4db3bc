"""Event trigger: decides when a new command is sent (paper, eq. ETC-law)."""

import numpy as np

from companion.control.gains import EtnnGains
from companion.control.switching import sign
from companion.core.types import Array
from companion.core.values import value
from companion.geometry.array_math import as_column, by_axis, columns, maximum, minimum, where


@value
class TriggerState:
    """State of the trigger: u held since the last event (m/s^2), (..., 3); kappa, and 1 after the first, (..., 1)."""

    held: Array
    kappa: Array
    started: Array


def initial_trigger(gains: EtnnGains, lead: tuple[int, ...] = ()) -> TriggerState:
    """Return the state that holds nothing: the first step is an event."""
    kappa = np.full((*lead, 1), gains.kappa_initial)
    return TriggerState(np.zeros((*lead, 3)), kappa, np.zeros((*lead, 1)))


def continuous_control(alpha2: Array, y2: Array, kappa: Array, gains: EtnnGains) -> Array:
    """Return u_bar = alpha_2 - (sigma + kappa/delta) sgn(y_2) (m/s^2), shape (..., 3)."""
    (size,) = columns(kappa)
    push = gains.switching * (gains.sigma + size / gains.delta)
    layer = gains.boundary_layer_mps
    return by_axis(lambda alpha, y: alpha - push * sign(y, layer), alpha2, y2)


def trigger_step(state: TriggerState, u_bar: Array, gains: EtnnGains, dt_s: float) -> tuple[TriggerState, Array, Array]:
    """Decide on an event and advance kappa; returns the new state, u (..., 3) and event (..., 1) as 0 or 1.

    The event takes effect before kappa is advanced, so |e_j| <= sigma + kappa/delta holds at every instant and kappa
    cannot become negative (for dt_s < delta / (1 + delta)).
    """
    x, y, z = columns(np.abs(state.held - u_bar))
    (kappa,), (started,) = columns(state.kappa), columns(state.started)
    worst, least = maximum(maximum(x, y), z), minimum(minimum(x, y), z)
    quiet = (kappa + gains.delta * (gains.sigma - worst) >= 0.0) & (started > 0.0)
    quiet = quiet & (gains.every_cycle ^ True)
    slack = gains.sigma - where(quiet, least, 0.0)  # the largest sigma - |e_j|
    kappa = kappa + dt_s * (slack - kappa)
    u = where(quiet, state.held, u_bar)
    return TriggerState(u, as_column(kappa), as_column(maximum(started, 1.0))), u, as_column(where(quiet, 0.0, 1.0))
