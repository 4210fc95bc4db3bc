"""Command filter, error compensation and virtual controls (paper, eqs. cmd-filter, iota-dyn, alpha1, alpha_2)."""

from dataclasses import dataclass

import numpy as np

from companion.control.gains import EtnnGains
from companion.control.switching import fractional_factor, squared, switch_factor
from companion.types import Array


@dataclass(frozen=True)
class FilterState:
    """chi (m/s), xi (m/s^2) of eq. cmd-filter; iota_1 (m), iota_2 (m/s) of eq. iota-dyn; each (..., 3)."""

    chi: Array
    xi: Array
    iota1: Array
    iota2: Array


def at_lift_off(alpha1: Array) -> FilterState:
    """The initial conditions of eq. cmd-filter: chi(0) = alpha_1(0), xi(0) = 0; the compensation starts at 0."""
    zero = np.zeros_like(alpha1)
    return FilterState(alpha1, zero, zero, zero)


def compensation_1(iota1: Array, gains: EtnnGains) -> Array:
    """c_1 |iota_1|^2 iota_1 + k iota_1 + k_1 Theta(iota_1): shared by alpha_1 and the iota_1 equation."""
    square = squared(iota1)
    theta = switch_factor(square, gains.p, gains.epsilon, gains.power_regularisation)
    return np.asarray((gains.c1 * square + gains.k + gains.k1 * theta) * iota1)


def compensation_2(iota2: Array, gains: EtnnGains) -> Array:
    """c_2 |iota_2|^2 iota_2 + k_2 iota_2/(iota_2'iota_2)^(1-p): shared by alpha_2 and the iota_2 equation."""
    square = squared(iota2)
    power = fractional_factor(square, gains.p, gains.power_regularisation)
    return np.asarray((gains.c2 * square + gains.k2 * power) * iota2)


def virtual_control_1(velocity_ref: Array, y1: Array, iota1: Array, gains: EtnnGains) -> Array:
    """alpha_1 (m/s), eq. alpha1, shape (..., 3): feedback beta_1 |y_1|^2 y_1 + gamma_1 Theta(y_1)."""
    square = squared(y1)
    theta = switch_factor(square, gains.p, gains.epsilon, gains.power_regularisation)
    feedback = (gains.beta1 * square + gains.gamma1 * theta) * y1
    return np.asarray(velocity_ref - compensation_1(iota1, gains) - feedback)


def virtual_control_2(chi_dot: Array, x1: Array, y2: Array, iota2: Array, gains: EtnnGains) -> Array:
    """alpha_2 (m/s^2), the auxiliary virtual control of step 2, (..., 3): feedback as in alpha_1, Theta not faded."""
    square = squared(y2)
    power = fractional_factor(square, gains.p, gains.power_regularisation)
    feedback = (gains.beta2 * square + gains.gamma2 * power) * y2
    return np.asarray(chi_dot - x1 - compensation_2(iota2, gains) - feedback)


def filter_step(state: FilterState, alpha1: Array, f_hat: Array, gains: EtnnGains, dt_s: float) -> FilterState:
    """Advance eqs. cmd-filter and iota-dyn by `dt_s` with alpha_1 and f_hat held.

    Semi-implicit Euler for the filter (xi before chi): explicit Euler pumps energy into one as fast as a few control
    periods. The compensation is slower and damped by itself: explicit Euler.
    """
    pull = gains.zeta * np.arctan(state.chi - alpha1) + gains.rho * np.arctan(gains.filter_eps * state.xi)
    xi = state.xi - dt_s / gains.filter_eps**2 * pull
    chi = state.chi + dt_s * xi
    iota1 = state.iota1 + dt_s * (state.iota2 + state.chi - alpha1 - compensation_1(state.iota1, gains))
    iota2 = state.iota2 + dt_s * (f_hat - state.iota1 - compensation_2(state.iota2, gains))
    return FilterState(chi, xi, iota1, iota2)
