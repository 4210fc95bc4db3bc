"""Arrays of traced numbers: numpy's own functions and operators write down what they do, as arithmetic does.

Only functions whose result is the same on every processor are written down. numpy's sin, exp or matmul round as its
vectorised code for this processor does, which no other code repeats: they are refused by name. `array_math` has such
functions, for one vehicle by Python's `math`.
"""

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from companion.geometry.traced import Traced

Elementwise = Callable[..., Any]


def _element(function: Callable[..., object], count: int) -> Elementwise:
    element: Elementwise = np.frompyfunc(function, count, 1)
    return element


def _power(base: Any, exponent: Any) -> Any:
    """Return what numpy computes for an array and a number, which is no power where the exponent is a simple one."""
    powers: dict[object, Callable[[], object]] = {
        2.0: lambda: base * base,
        1.0: lambda: base,
        0.5: lambda: Traced.of("sqrt", base),
        -1.0: lambda: 1.0 / base,
    }
    if isinstance(exponent, Traced) or exponent not in powers:
        raise TypeError("np.power rounds as this processor does: use ** on numbers, in a formula of `by_axis`")
    return powers[exponent]()


def _sign(x: Any) -> Any:
    return Traced.of("where", x > 0.0, 1.0, Traced.of("where", x < 0.0, -1.0, 0.0 * x))


def _clipped(x: object, low: object, high: object) -> Traced:
    return Traced.of("min", Traced.of("max", x, low), high)


_CLIP = _element(_clipped, 3)
_MAX, _MIN = (_element(lambda a, b, name=name: Traced.of(name, a, b), 2) for name in ("max", "min"))
_AND, _OR = _element(lambda a, b: a & b, 2), _element(lambda a, b: a | b, 2)
_NOT = _element(lambda a: a ^ True, 1)
_WHERE = _element(lambda *operands: Traced.of("where", *operands), 3)
_OWN: dict[Any, Elementwise] = {
    np.maximum: _MAX,
    np.minimum: _MIN,
    np.logical_and: _AND,
    np.logical_or: _OR,
    np.logical_not: _NOT,
    np.invert: _NOT,
    np.square: _element(lambda x: x * x, 1),
    np.reciprocal: _element(lambda x: 1.0 / x, 1),
    np.conjugate: _element(lambda x: x, 1),
    np.power: _element(_power, 2),
    np.sign: _element(_sign, 1),
    **{getattr(np, name): _element(lambda x, name=name: Traced.of(name, x), 1) for name in ("sqrt", "isfinite")},
    np.copysign: _element(lambda a, b: Traced.of("copysign", a, b), 2),
    np.fabs: _element(abs, 1),
}
"""Functions that are written down in another way than by the operators of the numbers."""
_AS_THEY_ARE = {np.add, np.subtract, np.multiply, np.true_divide, np.negative, np.positive, np.absolute}
_AS_THEY_ARE |= {np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal}
_AS_THEY_ARE |= {np.bitwise_and, np.bitwise_or, np.bitwise_xor}
_REDUCED: dict[Any, Elementwise] = {
    np.add: np.add,
    np.maximum: _MAX,
    np.minimum: _MIN,
    np.logical_and: _AND,
    np.logical_or: _OR,
}
_USUAL = {"initial": (None, np._NoValue), "where": (None, True), "dtype": (None, np.dtype(bool))}
"""Options of a function with which it is traced."""
_SUMMED_IN_ORDER = 7
"""Most numbers that numpy adds one after the other; it adds more in pairs."""


class TracedArray(np.ndarray[Any, np.dtype[Any]]):
    """Array of traced numbers."""

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        """Write down what a function of numpy does to every number."""
        plain, name = [np.asarray(each, dtype=object) for each in inputs], ufunc.__name__
        if any(not any(kwargs.get(option) is one for one in usual) for option, usual in _USUAL.items()):
            raise TypeError(f"np.{name} is traced without {' or '.join(_USUAL)}")
        if method == "reduce" and ufunc in _REDUCED:
            result = _reduced(ufunc, plain[0], kwargs.get("axis", 0), bool(kwargs.get("keepdims")))
        elif method == "__call__" and ufunc in _AS_THEY_ARE:
            result = as_traced(ufunc(*plain, dtype=object))
        elif method == "__call__" and (name == "clip" or ufunc in _OWN):
            result = as_traced((_CLIP if name == "clip" else _OWN[ufunc])(*plain))
        else:
            raise TypeError(f"np.{name} rounds as this processor does: see companion.law_api for another")
        (into,) = kwargs.get("out") or (None,)
        if into is None:
            return result
        into[...] = result
        return into

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        """Write down what the other functions do; where they only move numbers, numpy does it."""
        if function is np.where and len(arguments) == 3:
            return traced_where(*arguments)
        if function in (np.dot, np.inner, np.vdot, np.tensordot, np.einsum):
            self.dot(None)
        if function is np.linalg.norm:
            return _norm(*arguments, **options)
        if function in (np.zeros_like, np.ones_like):
            return function(np.empty(np.shape(arguments[0])))
        if function is np.full_like:
            return np.broadcast_to(arguments[1], np.shape(arguments[0]))
        return as_traced(super().__array_function__(function, types, arguments, options))

    def astype(self, dtype: Any, *arguments: Any, **options: Any) -> Any:
        """Return truths as 1 or 0; numbers stay."""
        del arguments, options
        if not np.issubdtype(np.dtype(dtype), np.floating):
            raise TypeError(f"a traced number becomes no {np.dtype(dtype).name}")
        return as_traced(_WHERE(self.view(np.ndarray), 1.0, 0.0) if _is_truth(self) else self.copy())

    def dot(self, other: object, out: object = None) -> Any:
        """Refuse: a product's sum rounds as the processor does."""
        del other, out
        raise TypeError("np.dot rounds as this processor does: use companion.law_api.dot")


def traced_where(*operands: object) -> Any:
    """Write down a choice for one number, or for each of an array."""
    return as_traced(_WHERE(*(np.asarray(each, dtype=object) for each in operands)))


def as_traced(result: Any) -> Any:
    """Return an array of traced numbers as such; anything else as it is."""
    return result.view(TracedArray) if isinstance(result, np.ndarray) and result.dtype.char == "O" else result


def _norm(vector: Any, axis: int | None = None, keepdims: bool = False) -> Any:
    """Return what numpy computes along an axis; without one it takes a product of vectors, which it rounds freely."""
    if axis is None:
        raise TypeError("np.linalg.norm without axis rounds as this processor does: name the axis")
    return np.sqrt(np.sum(vector * vector, axis=axis, keepdims=keepdims))


def _is_truth(array: "np.ndarray[Any, Any]") -> bool:
    truths = {"<", "<=", ">", ">=", "==", "!=", "&", "|", "^", "isfinite"}
    return all(isinstance(x, bool) or (isinstance(x, Traced) and x.operation in truths) for x in array.ravel().tolist())


def _reduced(function: Any, array: Any, axis: Any, keep: bool) -> Any:
    """Return a sum, maximum, minimum, any or all along one axis, or of a vector."""
    if axis is None:
        if array.ndim > 1:
            raise TypeError(f"np.{function.__name__} over all axes: name one")
        axis = 0
    rows: Sequence[Any] = list(np.moveaxis(array, axis if not isinstance(axis, tuple) else axis[0], 0))
    if function is np.add and len(rows) > _SUMMED_IN_ORDER:
        raise TypeError(f"a sum of {len(rows)} numbers is not one after the other: use companion.law_api.dot")
    result = reduce(_REDUCED[function], rows)
    return as_traced(np.expand_dims(result, axis)) if keep else as_traced(result)
