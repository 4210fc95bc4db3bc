"""Command filter, error compensation and virtual controls (paper, eqs. cmd-filter, iota-dyn, alpha1, alpha_2)."""

import numpy as np

from companion.control.gains import EtnnGains
from companion.control.switching import fractional_factor, squared, switch_factor
from companion.core.types import Array, Scalar
from companion.core.values import value
from companion.geometry.array_math import all_by_axis, by_axis, math_module

_NOTHING = np.zeros(3)
_ROUNDS = 20
"""Iterations of the fixed point at which the compensation is at rest."""


@value
class FilterState:
    """States chi (m/s), xi (m/s^2) of eq. cmd-filter and iota_1 (m), iota_2 (m/s) of eq. iota-dyn; each (..., 3)."""

    chi: Array
    xi: Array
    iota1: Array
    iota2: Array


def at_lift_off(alpha1: Array) -> FilterState:
    """Return the initial state of eq. cmd-filter: chi(0) = alpha_1(0), all others 0."""
    zero = np.zeros_like(alpha1)
    return FilterState(alpha1, zero, zero, zero)


def compensation_at_rest(f_hat: Array, gains: EtnnGains) -> tuple[Array, Array]:
    """Return iota_1 (m) and iota_2 (m/s), each (..., 3), as eq. iota-dyn settles under a constant f_hat.

    chi = alpha_1, iota_2 = a_1 iota_1 and f_hat = iota_1 + a_2 iota_2; a_1 and a_2 depend on them, hence the iteration.
    """
    if gains.compensation == 0.0:
        nothing = np.zeros_like(f_hat)
        return nothing, nothing
    iota1 = iota2 = 0.01 * f_hat
    for _ in range(_ROUNDS):
        (squared_1, theta_1), (squared_2, power_2) = _theta(iota1, gains), _power(iota2, gains)
        a1 = gains.c1 * squared_1 + gains.k + gains.k1 * theta_1
        a2 = gains.c2 * squared_2 + gains.k2 * power_2
        iota1 = 0.5 * (iota1 + f_hat / (1.0 + a1 * a2))
        iota2 = a1 * iota1
    return iota1, iota2


def in_motion(alpha1: Array, accel_mps2: Array, iota1: Array, iota2: Array, gains: EtnnGains) -> FilterState:
    """Return the filter as it follows an alpha_1 that changes by `accel_mps2`: that is xi, and chi is late."""
    lag_s = gains.rho * gains.filter_eps / gains.zeta
    xi = accel_mps2 + np.zeros_like(alpha1)
    return FilterState(alpha1 - lag_s * xi, xi, iota1, iota2)


def virtual_control_1(velocity_ref: Array, y1: Array, iota1: Array, gains: EtnnGains) -> Array:
    """Return alpha_1 (m/s), eq. alpha1, shape (..., 3): feedback beta_1 |y_1|^2 y_1 + gamma_1 Theta(y_1)."""
    (y_squared, y_theta), (iota_squared, iota_theta) = _theta(y1, gains), _theta(iota1, gains)

    def alpha1(y1: Scalar, velocity_ref: Scalar, iota1: Scalar, *diagonals: Scalar) -> Scalar:
        c1, k, k1, beta1, gamma1 = diagonals
        compensation = (c1 * iota_squared + k + k1 * iota_theta) * iota1
        return velocity_ref - compensation - (beta1 * y_squared + gamma1 * y_theta) * y1

    diagonals = (gains.c1, gains.k, gains.k1, gains.beta1, gains.gamma1)
    return by_axis(alpha1, y1, velocity_ref, iota1, *diagonals)


def virtual_control_2(chi_dot: Array, x1: Array, y2: Array, iota2: Array, gains: EtnnGains) -> Array:
    """Return alpha_2 (m/s^2), the virtual control of step 2, (..., 3): feedback as in alpha_1, Theta not faded."""
    (y_squared, y_power), (iota_squared, iota_power) = _power(y2, gains), _power(iota2, gains)

    def alpha2(y2: Scalar, chi_dot: Scalar, x1: Scalar, iota2: Scalar, *diagonals: Scalar) -> Scalar:
        c2, k2, beta2, gamma2 = diagonals
        compensation = (c2 * iota_squared + k2 * iota_power) * iota2
        return chi_dot - x1 - compensation - (beta2 * y_squared + gamma2 * y_power) * y2

    return by_axis(alpha2, y2, chi_dot, x1, iota2, *(gains.c2, gains.k2, gains.beta2, gains.gamma2))


def filter_step(
    state: FilterState, alpha1: Array, f_hat: Array, gains: EtnnGains, dt_s: float, past_mps2: Array = _NOTHING
) -> FilterState:
    """Advance eqs. cmd-filter and iota-dyn by `dt_s` with alpha_1 and f_hat held.

    `past_mps2` (..., 3) is the part of alpha_1' that is known and goes past the filter: chi' = xi + it.

    Semi-implicit Euler for the filter (xi before chi): explicit Euler pumps energy into one as fast as a few control
    periods. The compensation is slower and damped by itself: explicit Euler, of the share `gains.compensation`.
    """
    (squared_1, theta_1), (squared_2, power_2) = _theta(state.iota1, gains), _power(state.iota2, gains)
    zeta, rho, eps, share_s = gains.zeta, gains.rho, gains.filter_eps, dt_s * gains.compensation
    quick, m = dt_s / (eps * eps), math_module(squared_1)

    def advanced(chi: Scalar, xi: Scalar, iota1: Scalar, iota2: Scalar, *held: Scalar) -> tuple[Scalar, ...]:
        alpha1, f_hat, past, c1, k, k1, c2, k2 = held
        late = chi - alpha1
        xi_after = xi - quick * (zeta * m.atan(late) + rho * m.atan(eps * xi))
        iota1_rate = iota2 + late - (c1 * squared_1 + k + k1 * theta_1) * iota1
        iota2_rate = f_hat - iota1 - (c2 * squared_2 + k2 * power_2) * iota2
        return chi + dt_s * (xi_after + past), xi_after, iota1 + share_s * iota1_rate, iota2 + share_s * iota2_rate

    held = (alpha1, f_hat, past_mps2, gains.c1, gains.k, gains.k1, gains.c2, gains.k2)
    return FilterState(*all_by_axis(advanced, state.chi, state.xi, state.iota1, state.iota2, *held))


def _theta(s: Array, gains: EtnnGains) -> tuple[Scalar, Scalar]:
    """Return |s|^2, and the factor of s in Theta(s)."""
    square = squared(s)
    return square, switch_factor(square, gains.p, gains.epsilon, gains.power_regularisation)


def _power(s: Array, gains: EtnnGains) -> tuple[Scalar, Scalar]:
    """Return |s|^2, and the factor of s in s/(s's)^(1-p)."""
    square = squared(s)
    return square, fractional_factor(square, gains.p, gains.power_regularisation)
