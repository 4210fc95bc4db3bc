"""Linear models of a vehicle along one axis: position and its derivatives behind the lag of the actuation."""

import numpy as np

from companion.core.types import Array


def second_order(bandwidth_radps: float, damping: float) -> Array:
    """Return d/dt (p, v, a, j, u) with a following u by a second-order lag; u constant."""
    m = np.zeros((5, 5))
    m[0, 1] = m[1, 2] = m[2, 3] = 1.0
    m[3, 2:5] = -(bandwidth_radps**2), -2.0 * damping * bandwidth_radps, bandwidth_radps**2
    return m


def first_order(lag_s: float) -> Array:
    """Return d/dt (p, v, a, -, u) with a following u by a first-order lag; u constant."""
    m = np.zeros((5, 5))
    m[0, 1] = m[1, 2] = 1.0
    m[2, 2], m[2, 4] = -1.0 / lag_s, 1.0 / lag_s
    return m


def exponential(m: Array) -> Array:
    """Return the matrix exponential: scaling and squaring, 12 Taylor terms; exact to rounding for the sizes here."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(m).sum(axis=1).max(), 1e-9)))) + 3)
    x = m / 2.0**halvings
    result, term = np.eye(len(m)), np.eye(len(m))
    for n in range(1, 13):
        term = term @ x / n
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return np.asarray(result)
