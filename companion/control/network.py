"""Three-layer network that learns the friction (paper, eqs. DNN:fd:hat, update1, update2)."""

import numpy as np

from companion.control.gains import EtnnGains
from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import any_true, by_axis, dot, math_module, maximum, minimum, times, where


@value
class NetworkState:
    """Weight estimates: v0 (..., N_0+1, N_1) into the hidden layer, v1 (..., N_1+1, N_2) out of it."""

    v0: Array
    v1: Array


def initial_network(gains: EtnnGains, lead: tuple[int, ...] = ()) -> NetworkState:
    """Return the initial network: V_1 = 0, so the first output is 0; V_0 random from a seed.

    The paper does not give initial weights. With V_0 = 0 all hidden neurons would always get the same update and act
    as one.
    """
    rng = np.random.default_rng(gains.network_seed)
    v0 = gains.network_spread * rng.uniform(-1.0, 1.0, (gains.inputs + 1, gains.hidden))
    v1 = np.zeros((gains.hidden + 1, 3))
    return NetworkState(np.broadcast_to(v0, (*lead, *v0.shape)), np.broadcast_to(v1, (*lead, *v1.shape)))


def with_bias(state: NetworkState, f_hat: Array, gains: EtnnGains) -> NetworkState:
    """Return the network whose output is `f_hat` (m/s^2), (..., 3), whatever its input, within the ball of V_1."""
    v1 = np.zeros((*f_hat.shape[:-1], *state.v1.shape[-2:]))
    size = np.sqrt(np.vecdot(f_hat, f_hat))[..., None]
    v1[..., -1, :] = f_hat * np.minimum(1.0, gains.v1_max / np.maximum(size, 1e-300))
    return NetworkState(state.v0, v1)


def hidden_layer(state: NetworkState, v_d: Array) -> tuple[Array, Array]:
    """Return the input x_d = [p_d'; 1], (..., N_0+1), and activations phi = [sigmoid(V_0'x_d); 1], (..., N_1+1)."""
    x_d = _with_one(v_d)
    return x_d, _with_one(by_axis(_sigmoid, times(state.v0.mT, x_d)))


def _sigmoid(inner: Scalar) -> Scalar:
    """Return 1/(1 + exp(-inner)), computed by a tanh, which never overflows."""
    return 0.5 + 0.5 * math_module(inner).tanh(0.5 * inner)


def _with_one(vector: Array) -> Array:
    """Append the constant 1 that carries the bias."""
    return np.concatenate((vector, np.ones_like(vector[..., :1])), axis=-1)


def output(state: NetworkState, phi: Array) -> Array:
    """Return f_hat = V_1' phi (m/s^2), eq. DNN:fd:hat, shape (..., 3)."""
    return times(state.v1.mT, phi)


def network_step(state: NetworkState, x_d: Array, phi: Array, y2: Array, g: EtnnGains, dt_s: float) -> NetworkState:
    """Advance eqs. update1 and update2 by `dt_s`; both weight matrices stay in their balls."""
    slope = phi[..., :-1] * (1.0 - phi[..., :-1])  # phi' but for its last row, which is 0: the bias depends on nothing
    back = slope * times(state.v1[..., :-1, :], y2)
    rate1 = (g.gamma_v1 * phi)[..., :, None] * y2[..., None, :]
    rate0 = (g.gamma_v0 * x_d)[..., :, None] * back[..., None, :]
    v1 = bounded_step(state.v1, rate1, g.gamma_v1, g.v1_max, g.projection_band, dt_s)
    v0 = bounded_step(state.v0, rate0, g.gamma_v0, g.v0_max, g.projection_band, dt_s)
    return NetworkState(v0, v1)


def project(weights: Array, rate: Array, gamma: Array, bound: float, band: float) -> Array:
    """Return the smooth projection proj(rate) on the ball |weights|_F <= bound, shape as `weights`.

    With h = ((1 + band)|W|^2 - bound^2) / (band bound^2): inside h <= 0, or when the rate points inwards, the rate
    is returned as it is; else its Gamma-weighted outward part is removed in the proportion h, wholly at the boundary
    (Lavretsky and Gibson, "Projection operator in adaptive systems", 2011). `gamma` is diag(Gamma).
    """
    excess = ((1.0 + band) * _inner(weights, weights) - bound * bound) / (band * (bound * bound))
    outward = _inner(weights, rate)
    active = (excess > 0.0) & (outward > 0.0)
    if not any_true(active):
        return rate
    weighted = gamma[..., :, None] * weights
    scale = _inner(weights, weighted)
    return where(active, rate - excess * outward / where(scale > 0.0, scale, 1.0) * weighted, rate)


def bounded_step(weights: Array, rate: Array, gamma: Array, bound: float, band: float, dt_s: float) -> Array:
    """Return the weights after one Euler step along the projected rate; a step out of the ball ends on its surface.

    A free step that ends where the projection is inactive needs neither: it began there or points inwards.
    """
    free = np.asarray(weights + dt_s * rate)
    near = (1.0 + band) * _inner(free, free) > bound * bound
    if not any_true(near):
        return free
    moved = weights + dt_s * project(weights, rate, gamma, bound, band)
    square = _inner(moved, moved)
    size = math_module(square).sqrt(square)
    return where(near, np.asarray(moved * minimum(1.0, bound / maximum(size, 1e-300))), free)


def _inner(a: Array, b: Array) -> Scalar:
    """Return the sum of the products of all elements (Frobenius): a float, (..., 1, 1) for a batch."""
    total = dot(a.reshape(*a.shape[:-2], -1), b.reshape(*b.shape[:-2], -1))
    return total[..., None, None] if isinstance(total, np.ndarray) else total
