"""Vectors taken apart and put together again, so that one formula serves one vehicle and many.

One vehicle's components are Python floats: a tenth of the cost of numpy calls on single numbers. Those of a batch are
arrays over its leading axes.
"""

import math
from typing import Any

import numpy as np

from companion.types import Array


def parts(vector: Array) -> Any:
    """Components along the last axis: floats for shape (n,), arrays of shape (...) for (..., n)."""
    return vector.tolist() if vector.ndim == 1 else [vector[..., i] for i in range(vector.shape[-1])]


def joined(*components: Any) -> Array:
    """Inverse of `parts`, shape (..., n); batches must have their full shape in every component."""
    return np.stack(components, axis=-1) if isinstance(components[0], np.ndarray) else np.array(components, dtype=float)


def maths(component: Any) -> Any:
    """The module whose sqrt, sin, cos, atan2, asin fit a component."""
    return np if isinstance(component, np.ndarray) else math


def chosen(condition: Any, if_true: Any, if_false: Any) -> Any:
    """The one or the other: np.where for batches."""
    return (
        np.where(condition, if_true, if_false)
        if isinstance(condition, np.ndarray)
        else (if_true if condition else if_false)
    )
