"""Numbers inside nested values, in one order: dataclasses, gains, tuples and arrays as flat vectors."""

import copy
from collections.abc import Callable, Iterator
from math import prod
from typing import Any, TypeVar

import numpy as np

from companion.core.types import Array
from companion.geometry.traced import Traced

Value = TypeVar("Value")
_LEAF = (float, bool, np.ndarray, np.generic, Traced)


def mapped(value: Value, leaf: Callable[[str, Any], Any], path: str = "") -> Value:
    """Return a copy with `leaf(path, number or array)` in place of every number; names and counts stay."""
    made: Any = value
    if isinstance(value, _LEAF):
        made = leaf(path, value)
    elif isinstance(value, tuple):
        parts = [mapped(part, leaf, f"{path}.{index}") for index, part in enumerate(value)]
        made = type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    elif hasattr(value, "__dict__") and not isinstance(value, type):
        made, own = copy.copy(value), {name: mapped(part, leaf, f"{path}.{name}") for name, part in _fields(value)}
        made.__dict__.clear()  # of what is cached, which would still be the example's
        made.__dict__.update(own)
    return made  # type: ignore[no-any-return]


def _fields(value: object) -> Iterator[tuple[str, Any]]:
    names = getattr(value, "__dataclass_fields__", None) or getattr(type(value), "model_fields", None) or vars(value)
    return ((name, getattr(value, name)) for name in names)


def leaves(value: object) -> list[tuple[str, Any]]:
    """Return all numbers and arrays of numbers with their paths."""
    return list(_leaves(value, ""))


def _leaves(value: object, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, _LEAF):
        yield path.lstrip("."), value
    elif isinstance(value, tuple):
        for index, part in enumerate(value):
            yield from _leaves(part, f"{path}.{index}")
    elif hasattr(value, "__dict__") and not isinstance(value, type):
        for name, part in _fields(value):
            yield from _leaves(part, f"{path}.{name}")


def flat(value: object, like: object, lead: tuple[int, ...] = ()) -> Array:
    """Return all numbers of a value, in the order of `leaves`, as rows: one for all vehicles, or one each.

    `like` is the same value of a single vehicle: it says how many numbers each part has.
    """
    columns, each = [], False
    for (path, part), (same, example) in zip(leaves(value), leaves(like), strict=True):
        assert path == same
        array, size = np.asarray(part, dtype=float), prod(np.shape(example))
        own = bool(lead) and array.size > size
        each |= own
        columns.append(array.reshape(-1 if own else 1, size))
    if each:
        columns = [np.broadcast_to(column, (prod(lead), column.shape[1])) for column in columns]
    return np.concatenate(columns, axis=1)
