"""Least squares for a few parameters, with uncertainties that are valid for correlated errors."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array

Residuals = Callable[[Array], Array]
_STEPS = 40
_ENOUGH = 1e-4


@dataclass(frozen=True)
class Fit:
    """Parameters (p,), their standard deviations, and the explained share of the signal, at most 1."""

    values: Array
    sd: Array
    explained: float


def fit(
    residuals: Residuals, first: Array, steps: Array, bounds: tuple[Array, Array], block: NDArray[np.int_], power: float
) -> Fit:
    """Fit by Levenberg and Marquardt from `first` (p,) inside `bounds`; `steps` (p,) are those of the derivatives.

    Errors of neighbouring samples are not independent: each sample belongs to a `block` (n,) of some seconds, and the
    standard deviations come from how much the blocks disagree (the sandwich estimator for clusters). `power` is the
    mean square of what is to be explained.
    """
    values, damping = first.astype(np.float64), 1e-3
    error = residuals(values)
    jacobian = _jacobian(residuals, values, error, steps)
    for _ in range(_STEPS):
        normal = jacobian.T @ jacobian
        change = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), -jacobian.T @ error)
        tried = np.clip(values + change, *bounds)
        after = residuals(tried)
        if after @ after > error @ error:
            damping *= 10.0
            if damping > 1e8:
                break
            continue
        settled = (np.abs(tried - values) < _ENOUGH * steps).all()
        values, error, damping = tried, after, max(damping * 0.2, 1e-9)
        jacobian = _jacobian(residuals, values, error, steps)
        if settled:
            break
    return Fit(values, _deviations(jacobian, error, block), float(1.0 - (error @ error) / len(error) / power))


def _jacobian(residuals: Residuals, values: Array, error: Array, steps: Array) -> Array:
    columns = []
    for number, step in enumerate(steps):
        ahead = values.copy()
        ahead[number] += step
        columns.append((residuals(ahead) - error) / step)
    return np.column_stack(columns)


def _deviations(jacobian: Array, error: Array, block: NDArray[np.int_]) -> Array:
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    pulls = jacobian * error[:, None]
    sums = np.array([pulls[block == one].sum(axis=0) for one in np.unique(block)])
    few = len(sums) / max(len(sums) - 1, 1)
    covariance = few * inverse @ (sums.T @ sums) @ inverse
    return np.asarray(np.sqrt(np.diag(covariance)))
