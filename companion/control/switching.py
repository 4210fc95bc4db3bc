"""Switch map Theta of the paper, and related functions.

Equations are named by their place in the paper (Wang et al., "Neural Network-Based Adaptive Event-Triggered
Control for Dual-Arm Unmanned Aerial Manipulator Systems"). Vectors are (..., 3); scalars are floats, or
arrays of shape (..., 1) when a batch of vehicles has a batch of gains.
"""

import math

import numpy as np

from companion.core.types import Array, Scalar
from companion.geometry.array_math import any_true, by_axis, math_module, maximum, minimum, where


def squared(s: Array) -> Scalar:
    """Return s's: (..., 1) for a batch, a float for one vehicle, which makes later operations four times faster."""
    if s.ndim > 1:
        return np.asarray(np.vecdot(s, s)[..., None])
    x, y, z = s.tolist()
    square: Scalar = x * x + y * y + z * z
    return square


def fractional_factor(square: Scalar, p: Scalar, regularisation: Scalar = 0.0) -> Scalar:
    """Return 1 / (s's + e)^(1-p) from `square` = s's, shape as given: the factor of s in the fractional powers."""
    base = square + regularisation
    return where(base > 0.0, base, 1.0) ** (p - 1.0)


def switch_factor(square: Scalar, p: Scalar, epsilon: Scalar, regularisation: Scalar = 0.0) -> Scalar:
    """Return the factor of s in Theta(s), from `square` = s's, shape as given."""
    factor, printed = fractional_factor(square, p, regularisation), (regularisation > 0.0) ^ True
    if not any_true(printed):
        return factor
    share = minimum(square / epsilon, 1.0)
    return where(printed, factor * math_module(share).sin(share * (0.5 * math.pi)) ** 2, factor)


def switch_map(s: Array, p: Scalar, epsilon: Scalar, regularisation: Scalar = 0.0) -> Array:
    """Return Theta(s), Lemma 1: the fractional power, faded out by sin^2 inside |s|^2 <= epsilon, shape (..., 3).

    With a regularisation there is no singularity to fade, so the plain regularised power is returned.
    """
    return np.asarray(s * switch_factor(squared(s), p, epsilon, regularisation))


def steepest_secant(p: float, epsilon: float, regularisation: float) -> float:
    """Return the largest |Theta(s)|/|s| over all s: the gain with which Theta can act at most, per unit of error."""
    if regularisation > 0.0:
        return float(regularisation ** (p - 1.0))
    radius = np.sqrt(epsilon) * np.linspace(1e-3, 1.0, 2000)
    s = np.stack((radius, 0 * radius, 0 * radius), axis=-1)
    return float(np.max(switch_map(s, p, epsilon)[..., 0] / radius))


def sgn(y: Array, boundary_layer: Scalar = 0.0) -> Array:
    """Return sgn(y) of eq. ETC-law component by component, sgn(0) = 0; with a layer clip(y/layer, -1, 1)."""

    def of_axis(y: Scalar) -> Scalar:
        soft = minimum(maximum(y / maximum(boundary_layer, 1e-9), -1.0), 1.0)
        return where(boundary_layer > 0.0, soft, where(y > 0.0, 1.0, where(y < 0.0, -1.0, 0.0 * y)))

    return by_axis(of_axis, y)


def atan(s: Array) -> Array:
    """Return the arc tangent component by component, eq. cmd-filter."""
    return by_axis(lambda x: math_module(x).atan(x), s)
