"""Maths of components, whatever they are: floats of one vehicle, arrays of many, or numbers that write a formula down.

Numbers of other kinds bring their functions themselves: `maths`, `where`.
"""

import math
from typing import Any

import numpy as np

Number = Any
"""A float, an array (...,), or a number of another kind; formulas are the same for all."""


def maths(number: Number) -> Any:
    """Return what has sqrt, sin, atan2, ... for this number."""
    if isinstance(number, float):
        return math
    return np if isinstance(number, np.ndarray) else number.maths


def where(condition: Number, if_true: Number, if_false: Number) -> Number:
    """Return one number or the other."""
    if isinstance(condition, bool):
        return if_true if condition else if_false
    if isinstance(condition, np.ndarray):
        return np.where(condition, if_true, if_false)
    return condition.where(if_true, if_false)


def where_each(condition: Number, if_true: Any, if_false: Any) -> Any:
    """Return one nested tuple of numbers or the other."""
    if isinstance(condition, bool):  # one vehicle: nothing to put together number by number
        return if_true if condition else if_false
    if not isinstance(if_true, tuple):
        return where(condition, if_true, if_false)
    parts = [where_each(condition, *pair) for pair in zip(if_true, if_false, strict=True)]
    return type(if_true)(*parts) if hasattr(if_true, "_fields") else tuple(parts)


def is_anywhere(condition: Number) -> bool:
    """Return False if a condition holds for no vehicle."""
    if isinstance(condition, bool):
        return condition
    return bool(condition.any()) if isinstance(condition, np.ndarray) else True
