"""Numbers inside nested values, in one order: dataclasses, gains, tuples and arrays as flat vectors."""

import copy
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np

from companion.geometry.traced import Traced

Value = TypeVar("Value")


def mapped(value: Value, leaf: Callable[[str, Any], Any], path: str = "") -> Value:
    """Return a copy with `leaf(path, number or array)` in place of every number; names and counts stay."""
    made: Any = value
    if isinstance(value, float | bool | np.ndarray | np.generic | Traced):
        made = leaf(path, value)
    elif isinstance(value, tuple):
        parts = [mapped(part, leaf, f"{path}.{index}") for index, part in enumerate(value)]
        made = type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    elif hasattr(value, "__dict__") and not isinstance(value, type):
        made = copy.copy(value)
        made.__dict__.update({name: mapped(part, leaf, f"{path}.{name}") for name, part in _fields(value)})
    return made  # type: ignore[no-any-return]


def _fields(value: object) -> Iterator[tuple[str, Any]]:
    names = getattr(value, "__dataclass_fields__", None) or getattr(type(value), "model_fields", None) or vars(value)
    return ((name, getattr(value, name)) for name in names)


def leaves(value: object) -> list[tuple[str, Any]]:
    """Return all numbers and arrays of numbers with their paths."""
    found: list[tuple[str, Any]] = []
    mapped(value, lambda path, number: found.append((path.lstrip("."), number)))
    return found
