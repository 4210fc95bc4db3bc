"""The paper's switch map Theta and its relatives.

Equations are named by their place in the paper (Wang et al., "Neural Network-Based Adaptive Event-Triggered
Control for Dual-Arm Unmanned Aerial Manipulator Systems"). Vectors are (..., 3); scalars are floats, or
arrays of shape (..., 1) when a batch of vehicles has a batch of gains.
"""

import numpy as np

from companion.types import Array

Scalar = float | Array


def norm_squared(s: Array) -> Array:
    """s's with the last axis kept, shape (..., 1)."""
    s0, s1, s2 = s[..., 0:1], s[..., 1:2], s[..., 2:3]  # three products beat a reduction over a 3-vector
    return np.asarray(s0 * s0 + s1 * s1 + s2 * s2)


def fractional_power(s: Array, p: Scalar, regularisation: Scalar = 0.0) -> Array:
    """s / (s's + e)^(1-p), shape (..., 3); e = `regularisation`.

    With e = 0 this is the term of eq. iota-dyn and alpha_2 as printed; it is 0/0 at s = 0, whose limit is 0,
    and its slope there is unbounded. With e > 0 (a departure, `power_regularisation`) the slope is at most
    e^(p-1).
    """
    base = norm_squared(s) + regularisation
    return np.asarray(s * np.where(base > 0.0, base, 1.0) ** (p - 1.0))


def switch_map(s: Array, p: Scalar, epsilon: Scalar, regularisation: Scalar = 0.0) -> Array:
    """Theta(s), Lemma 1: the fractional power, faded out by sin^2 inside |s|^2 <= epsilon, shape (..., 3).

    With a regularisation there is no singularity to fade, so the plain regularised power is returned.
    """
    power = fractional_power(s, p, regularisation)
    if np.any(np.asarray(regularisation) > 0.0):
        return power
    fade = np.sin(np.minimum(norm_squared(s) / epsilon, 1.0) * (0.5 * np.pi)) ** 2
    return np.asarray(power * fade)


def steepest_secant(p: float, epsilon: float, regularisation: float) -> float:
    """Largest |Theta(s)|/|s| over all s: the gain with which Theta can act at most, per unit of error."""
    if regularisation > 0.0:
        return float(regularisation ** (p - 1.0))
    radius = np.sqrt(epsilon) * np.linspace(1e-3, 1.0, 2000)
    s = np.stack((radius, 0 * radius, 0 * radius), axis=-1)
    return float(np.max(switch_map(s, p, epsilon)[..., 0] / radius))


def sign(y: Array, boundary_layer: Scalar = 0.0) -> Array:
    """sgn(y) of eq. ETC-law, componentwise, sgn(0) = 0; with a boundary layer, clip(y / layer, -1, 1)."""
    layer = np.asarray(boundary_layer)
    if not np.any(layer > 0.0):
        return np.asarray(np.sign(y))
    return np.asarray(np.clip(y / np.maximum(layer, 1e-9), -1.0, 1.0))
