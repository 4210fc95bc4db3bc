"""The stability proof along a recorded flight: V of eq. V-comp, the ideal weights it needs, the bounds that were kept.

What the proof promises for it is in `fixed_time.py`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from companion.control.gains import EtnnGains
from companion.control.network import NetworkState, hidden_layer, output
from companion.core.types import Array


@dataclass(frozen=True)
class IdealWeights:
    """V_0 (N_0+1, N_1) and V_1 (N_1+1, 3) of eq. DNN:fd, and the largest |varepsilon| (m/s^2) they leave."""

    v0: Array
    v1: Array
    residual_mps2: float


def fit_ideal_output_weights(
    v0: Array, velocity_ref_w_mps: Array, friction_w_mps2: Array, gains: EtnnGains
) -> IdealWeights:
    """The ideal weights of eq. DNN:fd for a friction that is known, as it is in a simulation.

    The ideal pair is not unique and the paper only asks that one exists. Here V_0 is taken as given, usually the last
    estimate of a flight, and V_1 is the best answer to it: least squares of the friction f(p_d') = -F_f/m_t (n, 3) at
    the reference velocities (n, 3) on the hidden layer's activations. Both are kept in the inner ball of their
    projection, |V| <= v_max/sqrt(1 + band), where proj cannot cost the proof anything. Any choice is valid, with its
    own V and its own residual.
    """
    inner = 1.0 / np.sqrt(1.0 + gains.projection_band)
    v0 = v0 * min(1.0, gains.v0_max * inner / max(float(np.linalg.norm(v0)), 1e-300))
    state = NetworkState(np.broadcast_to(v0, (len(velocity_ref_w_mps), *v0.shape)), np.zeros((gains.hidden + 1, 3)))
    _, phi = hidden_layer(state, velocity_ref_w_mps)
    v1 = _least_squares_in_ball(phi, friction_w_mps2, gains.v1_max * inner)
    left = friction_w_mps2 - output(NetworkState(v0, v1), phi)
    return IdealWeights(v0, v1, float(np.linalg.norm(left, axis=-1).max()))


def _least_squares_in_ball(features: Array, targets: Array, radius: float) -> Array:
    """The W with |W|_F <= radius that makes |features W - targets| least: W(r) = (F'F + r I)^-1 F'T, the least r >= 0.

    |W(r)| falls with r (Hastie, Tibshirani and Friedman, "Elements of Statistical Learning", section 3.4.1).
    """
    left, size, right = np.linalg.svd(features, full_matrices=False)
    seen = size > 1e-10 * size[0]
    left, size, right = left[:, seen], size[seen], right[seen]
    along = left.T @ targets

    def weights(ridge: float) -> Array:
        return np.asarray(right.T @ ((size / (size**2 + ridge))[:, None] * along))

    low, high = 0.0, float(size[0] * np.linalg.norm(along)) / radius
    if float(np.linalg.norm(weights(0.0))) <= radius:
        return weights(0.0)
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(np.linalg.norm(weights(middle))) > radius else (low, middle)
    return weights(high)


@dataclass(frozen=True)
class Lyapunov:
    """The parts of V over time, eqs. V_1, V_2 and V-comp; each (...,) as the signals lead."""

    y1: Array
    """y_1'y_1/2, m^2."""
    y2: Array
    """y_2'y_2/2, (m/s)^2; the paper adds them all up as numbers, in SI units."""
    iota1: Array
    iota2: Array
    weights0: Array
    """tr(V~_0' Gamma_0^-1 V~_0)/2."""
    weights1: Array
    """tr(V~_1' Gamma_1^-1 V~_1)/2."""

    @property
    def states(self) -> Array:
        """V without the weights: the only part that eq. Vdot_ft makes fall."""
        return np.asarray(self.y1 + self.y2 + self.iota1 + self.iota2)

    @property
    def total(self) -> Array:
        """Return V of eq. V-comp for each cycle."""
        return np.asarray(self.states + self.weights0 + self.weights1)


def lyapunov_of(signals: Mapping[str, Array], gains: EtnnGains, ideal: IdealWeights | None = None) -> Lyapunov:
    """V of eq. V-comp along a flight.

    `signals` holds y1, y2, iota1, iota2 (..., 3) as the law records them, and with `ideal` weights also the estimates
    v0 (..., N_0+1, N_1) and v1 (..., N_1+1, 3). Without `ideal` the weights' parts are 0. So are those of rows whose
    gain in Gamma is 0: their estimate never moves.
    """
    halves = {name: 0.5 * np.vecdot(signals[name], signals[name]) for name in ("y1", "y2", "iota1", "iota2")}
    if ideal is None:
        none = np.zeros_like(halves["y1"])
        return Lyapunov(**halves, weights0=none, weights1=none)
    return Lyapunov(
        **halves,
        weights0=_weight_part(ideal.v0 - signals["v0"], gains.gamma_v0),
        weights1=_weight_part(ideal.v1 - signals["v1"], gains.gamma_v1),
    )


def _weight_part(error: Array, gamma: Array) -> Array:
    inverse = np.where(gamma > 0.0, 1.0 / np.maximum(gamma, 1e-300), 0.0)
    return np.asarray(0.5 * (inverse[:, None] * error**2).sum(axis=(-2, -1)))


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Bounds that the proof assumes."""

    delta_mps2: float = 0.0
    """Bar Delta of assumption 1; dry friction belongs here, as its slope at rest has no useful L_f."""
    lipschitz_per_s: float = 0.0
    """L_f of eq. f-Lip."""
    filter_error_mps: float = 0.0
    """|bar xi| of eq. chi-bound, the norm over the axes."""
    f_hat_mps2: float = 0.0
    """Bar f_d, the largest |f_hat|."""
    residual_mps2: float = 0.0
    """varepsilon_0 of Property 3."""
    x_d: float = 1.0
    """Largest |x_d|, with its constant 1."""
    v0_error: float = 0.0
    """Largest Frobenius norm of V~_0."""
    v1_error: float = 0.0
    """Largest Frobenius norm of V~_1, m/s^2."""
    v1_size: float = 0.0
    """Largest Frobenius norm of the estimate of V_1, m/s^2."""


def measured_bounds(
    signals: Mapping[str, Array],
    velocity_ref_w_mps: Array,
    *,
    delta_mps2: float,
    lipschitz_per_s: float,
    ideal: IdealWeights | None = None,
) -> Bounds:
    """The bounds that one flight kept: its largest |chi - alpha_1|, |f_hat|, |x_d| and weight errors.

    `signals` as for `lyapunov_of`, with chi, alpha1 and f_hat (n, 3). What they give is true of this flight, not of
    every one. Without `ideal`, whatever the friction does beyond f_hat belongs into `delta_mps2`.
    """
    known = {
        "delta_mps2": delta_mps2,
        "lipschitz_per_s": lipschitz_per_s,
        "filter_error_mps": _largest(signals["chi"] - signals["alpha1"], -1),
        "f_hat_mps2": _largest(signals["f_hat"], -1),
        "x_d": math.hypot(_largest(velocity_ref_w_mps, -1), 1.0),
    }
    if ideal is None:
        return Bounds(**known)
    return Bounds(
        **known,
        residual_mps2=ideal.residual_mps2,
        v0_error=_largest(ideal.v0 - signals["v0"], (-2, -1)),
        v1_error=_largest(ideal.v1 - signals["v1"], (-2, -1)),
        v1_size=_largest(signals["v1"], (-2, -1)),
    )


def _largest(values: Array, axis: int | tuple[int, int]) -> float:
    return float(np.sqrt((values**2).sum(axis=axis)).max())
