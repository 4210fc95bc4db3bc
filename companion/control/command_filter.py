"""Command filter, error compensation and virtual controls (paper, eqs. cmd-filter, iota-dyn, alpha1, alpha_2)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.control.components import all_by_axis, by_axis, maths
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
    return by_axis(lambda i, c1, k, k1: (c1 * square + k + k1 * theta) * i, iota1, gains.c1, gains.k, gains.k1)


def compensation_2(iota2: Array, gains: EtnnGains) -> Array:
    """c_2 |iota_2|^2 iota_2 + k_2 iota_2/(iota_2'iota_2)^(1-p): shared by alpha_2 and the iota_2 equation."""
    square = squared(iota2)
    power = fractional_factor(square, gains.p, gains.power_regularisation)
    return by_axis(lambda i, c2, k2: (c2 * square + k2 * power) * i, iota2, gains.c2, gains.k2)


def virtual_control_1(velocity_ref: Array, y1: Array, iota1: Array, gains: EtnnGains) -> Array:
    """alpha_1 (m/s), eq. alpha1, shape (..., 3): feedback beta_1 |y_1|^2 y_1 + gamma_1 Theta(y_1)."""
    square = squared(y1)
    theta = switch_factor(square, gains.p, gains.epsilon, gains.power_regularisation)

    def alpha1(y1: Any, velocity_ref: Any, compensation: Any, beta1: Any, gamma1: Any) -> Any:
        return velocity_ref - compensation - (beta1 * square + gamma1 * theta) * y1

    return by_axis(alpha1, y1, velocity_ref, compensation_1(iota1, gains), gains.beta1, gains.gamma1)


def virtual_control_2(chi_dot: Array, x1: Array, y2: Array, iota2: Array, gains: EtnnGains) -> Array:
    """alpha_2 (m/s^2), the auxiliary virtual control of step 2, (..., 3): feedback as in alpha_1, Theta not faded."""
    square = squared(y2)
    power = fractional_factor(square, gains.p, gains.power_regularisation)

    def alpha2(y2: Any, x1: Any, chi_dot: Any, compensation: Any, beta2: Any, gamma2: Any) -> Any:
        return chi_dot - x1 - compensation - (beta2 * square + gamma2 * power) * y2

    return by_axis(alpha2, y2, x1, chi_dot, compensation_2(iota2, gains), gains.beta2, gains.gamma2)


def filter_step(state: FilterState, alpha1: Array, f_hat: Array, gains: EtnnGains, dt_s: float) -> FilterState:
    """Advance eqs. cmd-filter and iota-dyn by `dt_s` with alpha_1 and f_hat held.

    Semi-implicit Euler for the filter (xi before chi): explicit Euler pumps energy into one as fast as a few control
    periods. The compensation is slower and damped by itself: explicit Euler, of the share `gains.compensation`.
    """
    rate_s, share_s = dt_s / gains.filter_eps**2, dt_s * gains.compensation

    def advanced(chi: Any, xi: Any, iota1: Any, iota2: Any, alpha1: Any, f_hat: Any, out1: Any, out2: Any) -> Any:
        m = maths(chi)
        xi_after = xi - rate_s * (gains.zeta * m.atan(chi - alpha1) + gains.rho * m.atan(gains.filter_eps * xi))
        iota1_after = iota1 + share_s * (iota2 + chi - alpha1 - out1)
        iota2_after = iota2 + share_s * (f_hat - iota1 - out2)
        return chi + dt_s * xi_after, xi_after, iota1_after, iota2_after

    out1, out2 = compensation_1(state.iota1, gains), compensation_2(state.iota2, gains)
    return FilterState(*all_by_axis(advanced, state.chi, state.xi, state.iota1, state.iota2, alpha1, f_hat, out1, out2))
