"""Component-wise maths, so that one formula serves one vehicle and a batch of vehicles.

Components of one vehicle are Python floats: a tenth of the cost of numpy calls on single numbers. Those of a batch are
arrays over its leading axes. Floats propagate NaN as numpy does, which Python's own min and max do not.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from companion.core.types import Array


def unstack(vector: Array) -> Any:
    """Return the components along the last axis: floats for shape (n,), arrays of shape (...) for (..., n)."""
    return vector.tolist() if vector.ndim == 1 else [vector[..., i] for i in range(vector.shape[-1])]


def columns(vector: Array) -> Any:
    """Return the components as `unstack` does, but with shape (..., 1) for a batch, as a batch of gains has it."""
    return vector.tolist() if vector.ndim == 1 else [vector[..., i : i + 1] for i in range(vector.shape[-1])]


def as_column(component: Any) -> Array:
    """Return one of `columns` as an array, (..., 1)."""
    return component if isinstance(component, np.ndarray) else np.array((component,))


def stack(*components: Any) -> Array:
    """Return the vector (..., n) of these components; in a batch the first one must have the full shape."""
    first = components[0]
    if not isinstance(first, np.ndarray):
        return np.array(components)
    vector = np.empty((*first.shape, len(components)))  # np.stack takes twice as long
    for axis, component in enumerate(components):
        vector[..., axis] = component
    return vector


def number(scalar: Array) -> Any:
    """Return a scalar of one vehicle, shape (), as a float; one of a batch, shape (...), unchanged."""
    return scalar if scalar.ndim else scalar.item()


def column(component: Any) -> Any:
    """Return a factor for vectors (..., n): shape (..., 1) for a batch, the float itself for one vehicle."""
    return component[..., None] if isinstance(component, np.ndarray) else component


def by_axis(formula: Callable[..., Any], first: Array, *others: Array) -> Array:
    """Apply `formula`, written for one axis, to vectors (..., n): per axis for one vehicle, all at once for a batch.

    `first` must have the leading axes of the batch; the others, such as gains, may lack them.
    """
    if first.ndim > 1:
        return np.asarray(formula(first, *others))
    return np.array([*map(formula, first.tolist(), *[vector.tolist() for vector in others])])


def all_by_axis(formula: Callable[..., Any], first: Array, *others: Array) -> Sequence[Array]:
    """Apply a formula as `by_axis` does, for one that returns several numbers per axis."""
    if first.ndim > 1:
        several: Sequence[Array] = formula(first, *others)
        return several
    of_each_axis = map(formula, first.tolist(), *[vector.tolist() for vector in others])
    return [np.array(column_) for column_ in zip(*of_each_axis, strict=True)]


def along_axes(formula: Callable[..., Any], first: Any, *others: Any) -> Any:
    """Apply a formula as `all_by_axis` does, to vectors that are tuples of floats for one vehicle, and return such."""
    if isinstance(first, np.ndarray):
        return formula(first, *others)
    return zip(*map(formula, first, *others), strict=True)


def dot(a: Array, b: Array) -> Any:
    """Return the scalar product along the last axis: a float for shape (n,), (...) for (..., n)."""
    if a.ndim == b.ndim == 1:
        return float(a.dot(b))
    return np.vecdot(a, b)


def math_module(component: Any) -> Any:
    """Return the module, math or numpy, whose sqrt, sin, atan2, ... fit this component."""
    return np if isinstance(component, np.ndarray) else math


def where(condition: Any, if_true: Any, if_false: Any) -> Any:
    """Return `if_true` where `condition` holds, else `if_false`: np.where for a batch."""
    return (
        np.where(condition, if_true, if_false)
        if isinstance(condition, np.ndarray)
        else (if_true if condition else if_false)
    )


def any_true(condition: Any) -> bool:
    """Return True if the condition holds for any vehicle."""
    return bool(condition.any() if isinstance(condition, np.ndarray) else condition)


def maximum(a: Any, b: Any) -> Any:
    """Return the larger of both; NaN if either is NaN."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.maximum(a, b)
    return a if a >= b or math.isnan(a) else b


def minimum(a: Any, b: Any) -> Any:
    """Return the smaller of both; NaN if either is NaN."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.minimum(a, b)
    return a if a <= b or math.isnan(a) else b
