"""Vectors taken apart and put together again, so that one formula serves one vehicle and many.

One vehicle's components are Python floats: a tenth of the cost of numpy calls on single numbers. Those of a batch are
arrays over its leading axes. Floats keep numpy's ways with NaN here, which Python's own min and max do not.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from companion.core.types import Array


def unstack(vector: Array) -> Any:
    """Components along the last axis: floats for shape (n,), arrays of shape (...) for (..., n)."""
    return vector.tolist() if vector.ndim == 1 else [vector[..., i] for i in range(vector.shape[-1])]


def columns(vector: Array) -> Any:
    """`parts`, but those of a batch keep their axis, (..., 1), as a batch of gains has it."""
    return vector.tolist() if vector.ndim == 1 else [vector[..., i : i + 1] for i in range(vector.shape[-1])]


def as_column(component: Any) -> Array:
    """One of `columns` as an array again, (..., 1)."""
    return component if isinstance(component, np.ndarray) else np.array((component,))


def stack(*components: Any) -> Array:
    """Inverse of `parts`, shape (..., n); in batches the first component must have the full shape."""
    first = components[0]
    if not isinstance(first, np.ndarray):
        return np.array(components)
    vector = np.empty((*first.shape, len(components)))  # np.stack takes twice as long
    for axis, component in enumerate(components):
        vector[..., axis] = component
    return vector


def number(scalar: Array) -> Any:
    """One vehicle's scalar, shape (), as a float; a batch's, shape (...), as it is."""
    return scalar if scalar.ndim else scalar.item()


def column(component: Any) -> Any:
    """What a vector (..., n) can be scaled with: (..., 1) for a batch, the float itself for one vehicle."""
    return component[..., None] if isinstance(component, np.ndarray) else component


def by_axis(formula: Callable[..., Any], first: Array, *others: Array) -> Array:
    """`formula`, written for one axis, of vectors (..., n): axis by axis for one vehicle, all axes at once for a batch.

    `first` must have the batch's axes; the others may be without, as gains are.
    """
    if first.ndim > 1:
        return np.asarray(formula(first, *others))
    return np.array([*map(formula, first.tolist(), *[vector.tolist() for vector in others])])


def all_by_axis(formula: Callable[..., Any], first: Array, *others: Array) -> Sequence[Array]:
    """`by_axis` for a formula that gives several numbers of each axis."""
    if first.ndim > 1:
        several: Sequence[Array] = formula(first, *others)
        return several
    of_each_axis = map(formula, first.tolist(), *[vector.tolist() for vector in others])
    return [np.array(column_) for column_ in zip(*of_each_axis, strict=True)]


def along_axes(formula: Callable[..., Any], first: Any, *others: Any) -> Any:
    """`all_by_axis` for vectors that are kept as tuples of floats for one vehicle, and come out as such."""
    if isinstance(first, np.ndarray):
        return formula(first, *others)
    return zip(*map(formula, first, *others), strict=True)


def dot(a: Array, b: Array) -> Any:
    """Scalar product along the last axis: a float for shape (n,), (...) for (..., n)."""
    if a.ndim == b.ndim == 1:
        return float(a.dot(b))
    return np.vecdot(a, b)


def math_module(component: Any) -> Any:
    """The module whose sqrt, sin, cos, atan, atan2, asin, tanh, isfinite fit a component."""
    return np if isinstance(component, np.ndarray) else math


def where(condition: Any, if_true: Any, if_false: Any) -> Any:
    """The one or the other: np.where for batches."""
    return (
        np.where(condition, if_true, if_false)
        if isinstance(condition, np.ndarray)
        else (if_true if condition else if_false)
    )


def any_true(condition: Any) -> bool:
    """Whether a condition holds for any vehicle."""
    return bool(condition.any() if isinstance(condition, np.ndarray) else condition)


def maximum(a: Any, b: Any) -> Any:
    """The larger one; NaN if there is one."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.maximum(a, b)
    return a if a >= b or math.isnan(a) else b


def minimum(a: Any, b: Any) -> Any:
    """The smaller one; NaN if there is one."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.minimum(a, b)
    return a if a <= b or math.isnan(a) else b
