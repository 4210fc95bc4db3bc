"""Component-wise maths, so that one formula serves one vehicle, a batch of vehicles, and the compiler.

Components of one vehicle are Python floats: a tenth of the cost of numpy calls on single numbers. Those of a batch are
arrays over its leading axes. Traced numbers (`traced`) are components of one vehicle that write the formula down; its
vectors are then arrays of objects. Floats propagate NaN as numpy does, which Python's own min and max do not. Functions
are named as numpy's where numpy has them.

Sums of products of one vehicle are added from the first to the last: numpy leaves the order to the processor.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, Protocol, TypeVar, cast, overload

import numpy as np

from companion.core.types import Array, Flag, Scalar
from companion.geometry.traced import TRACED_MATHS, Traced
from companion.geometry.traced_array import as_traced, traced_where

Components = tuple[float, ...] | Array
"""Vector as a tuple of floats for one vehicle, as an array (..., n) for a batch."""
Formula = Callable[..., Scalar]
"""Formula for the components of one axis."""
Formulas = Callable[..., Iterable[Scalar]]
"""Formula that returns several numbers for one axis."""
Value = TypeVar("Value")


class MathModule(Protocol):
    """Functions that math and numpy both have; math's take floats alone."""

    sqrt: Callable[[Scalar], Scalar]
    sin: Callable[[Scalar], Scalar]
    cos: Callable[[Scalar], Scalar]
    tan: Callable[[Scalar], Scalar]
    atan: Callable[[Scalar], Scalar]
    atan2: Callable[[Scalar, Scalar], Scalar]
    exp: Callable[[Scalar], Scalar]
    expm1: Callable[[Scalar], Scalar]
    tanh: Callable[[Scalar], Scalar]
    copysign: Callable[[Scalar, Scalar], Scalar]
    isfinite: Callable[[Scalar], Flag]


absolute = cast(Callable[[Scalar], Scalar], abs)
"""Size of a number; Python's own abs, with the type of a component."""

_MATH, _NUMPY = cast(MathModule, math), cast(MathModule, np)
_TRACED: type[Any] = Traced  # to the type checker a traced number is a float: formulas do not tell them apart


def math_module(component: Scalar) -> MathModule:
    """Return the module, math or numpy, whose sqrt, sin, atan2, ... fit this component."""
    if isinstance(component, np.ndarray):
        return _NUMPY
    return cast(MathModule, TRACED_MATHS) if isinstance(component, _TRACED) else _MATH


def unstack(vector: Array) -> list[Scalar]:
    """Return the components along the last axis: floats for shape (n,), arrays of shape (...) for (..., n)."""
    if vector.ndim == 1:
        components: list[Scalar] = vector.tolist()
        return components
    return [vector[..., i] for i in range(vector.shape[-1])]


def _vector(components: Iterable[Scalar]) -> Array:
    """Return the components of one vehicle as an array."""
    vector = np.array(components)
    return vector if vector.dtype.char == "d" else as_traced(vector)


def stack(*components: Scalar) -> Array:
    """Return the vector (..., n) of these components; in a batch the first one must have the full shape."""
    first = components[0]
    if not isinstance(first, np.ndarray):
        return _vector(components)
    vector = np.empty((*first.shape, len(components)))  # np.stack takes twice as long
    for axis, component in enumerate(components):
        vector[..., axis] = component
    return vector


def columns(vector: Array) -> list[Scalar]:
    """Return the components as `unstack` does, but with shape (..., 1) for a batch, as a batch of gains has it."""
    if vector.ndim == 1:
        components: list[Scalar] = vector.tolist()
        return components
    return [vector[..., i : i + 1] for i in range(vector.shape[-1])]


def as_column(component: Scalar) -> Array:
    """Return one of `columns` as an array, (..., 1)."""
    return component if isinstance(component, np.ndarray) else _vector((component,))


@overload
def column(component: Flag) -> Flag: ...
@overload
def column(component: Scalar) -> Scalar: ...
def column(component: Scalar | Flag) -> Scalar | Flag:
    """Return a factor or condition for vectors (..., n): shape (..., 1) for a batch, unchanged for one vehicle."""
    return component[..., None] if isinstance(component, np.ndarray) else component


def item(scalar: Array) -> Scalar:
    """Return a scalar of one vehicle, shape (), as a float; one of a batch, shape (...), unchanged."""
    return scalar if isinstance(scalar, _TRACED) or scalar.ndim else scalar.item()


def by_axis(formula: Formula, first: Array, *others: Array) -> Array:
    """Apply `formula`, written for one axis, to vectors (..., n): per axis for one vehicle, all at once for a batch.

    `first` must have the leading axes of the batch; the others, such as gains, may lack them.
    """
    if first.ndim > 1:
        return np.asarray(formula(first, *others))
    return _vector([*map(formula, first.tolist(), *[vector.tolist() for vector in others])])


def all_by_axis(formula: Formulas, first: Array, *others: Array) -> Iterable[Array]:
    """Apply a formula as `by_axis` does, for one that returns several numbers per axis."""
    if first.ndim > 1:
        return cast(Iterable[Array], formula(first, *others))
    return map(_vector, zip(*map(formula, first.tolist(), *[vector.tolist() for vector in others]), strict=True))


def along_axes(formula: Formulas, first: Components, *others: Components) -> Iterable[Components]:
    """Apply a formula as `all_by_axis` does, to vectors that are tuples of floats for one vehicle, and return such."""
    if isinstance(first, np.ndarray):
        return cast(Iterable[Array], formula(first, *others))
    return zip(*map(formula, first, *others), strict=True)


def dot(a: Array, b: Array) -> Scalar:
    """Return the scalar product along the last axis: a float for shape (n,), (...) for (..., n)."""
    return _summed(a.tolist(), b.tolist()) if a.ndim == b.ndim == 1 else np.asarray(np.vecdot(a, b))


def length(vector: Array) -> Scalar:
    """Return the Euclidean length along the last axis: a float for shape (n,), (...) for (..., n)."""
    if vector.ndim > 1:
        return np.asarray(np.sqrt(np.vecdot(vector, vector)))
    components = vector.tolist()
    return cast(Scalar, Traced.of("norm", *components)) if _is_traced(vector) else math.hypot(*components)


def _is_traced(vector: Array) -> bool:
    return vector.dtype == object


def dots(a: Array, b: Array) -> Array:
    """Return the scalar products of row after row of two matrices (..., n, m), shape (..., n)."""
    if a.ndim > 2 or b.ndim > 2:
        return np.asarray(np.vecdot(a, b))
    return _vector([*map(_summed, a.tolist(), b.tolist())])


def times(matrix: Array, vector: Array) -> Array:
    """Return (..., n, m) times (..., m), shape (..., n)."""
    if matrix.ndim > 2 or vector.ndim > 1:
        return np.asarray(np.vecdot(matrix, vector[..., None, :]))
    row = vector.tolist()
    return _vector([_summed(column, row) for column in matrix.tolist()])


def _summed(a: list[Scalar], b: list[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


@overload
def where(condition: Flag, if_true: Array, if_false: Array) -> Array: ...
@overload
def where(condition: Flag, if_true: Flag, if_false: Flag) -> Flag: ...
@overload
def where(condition: Flag, if_true: Scalar, if_false: Scalar) -> Scalar: ...
def where(condition: Flag, if_true: Scalar | Flag, if_false: Scalar | Flag) -> Scalar | Flag:
    """Return `if_true` where `condition` holds, else `if_false`: np.where for a batch."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, if_true, if_false)
    if isinstance(condition, _TRACED):
        return cast(Scalar, traced_where(condition, if_true, if_false))
    return if_true if condition else if_false


def where_each(condition: Flag, if_true: Value, if_false: Value) -> Value:
    """Return the result of `where` for every number in two tuples, or dataclasses, of numbers or of such again."""
    if isinstance(if_true, tuple) and isinstance(if_false, tuple):
        return cast(Value, tuple(where_each(condition, *pair) for pair in zip(if_true, if_false, strict=True)))
    if not hasattr(if_true, "__dataclass_fields__"):
        return cast(Value, where(condition, cast(Scalar, if_true), cast(Scalar, if_false)))
    other = vars(if_false)
    return type(if_true)(**{name: where_each(condition, part, other[name]) for name, part in vars(if_true).items()})


def any_true(condition: Flag) -> bool:
    """Return True if the condition holds for any vehicle; of a traced one it may."""
    if isinstance(condition, _TRACED):
        return True
    return bool(condition.any() if isinstance(condition, np.ndarray) else condition)


def maximum(a: Scalar, b: Scalar) -> Scalar:
    """Return the larger of both; NaN if either is NaN."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.maximum(a, b)
    if isinstance(a, _TRACED) or isinstance(b, _TRACED):
        return cast(Scalar, Traced.of("max", a, b))
    return a if a >= b or math.isnan(a) else b


def minimum(a: Scalar, b: Scalar) -> Scalar:
    """Return the smaller of both; NaN if either is NaN."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.minimum(a, b)
    if isinstance(a, _TRACED) or isinstance(b, _TRACED):
        return cast(Scalar, Traced.of("min", a, b))
    return a if a <= b or math.isnan(a) else b
