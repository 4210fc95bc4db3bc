"""Values made of dataclasses, arrays and numbers to JSON and back, exact to the last bit."""

import json
from dataclasses import fields, is_dataclass
from enum import Enum
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

Value = TypeVar("Value")


def to_json(value: object) -> str:
    """Return the text for `of_json`, with Python's words for what JSON has no number for (NaN, Infinity)."""
    return json.dumps(_plain(value))


def of_json(kind: type[Value], text: str) -> Value:
    """Return the value given to `to_json`, a `kind`; KeyError, TypeError or ValueError for a text of another kind."""
    return _restored(kind, json.loads(text))  # type: ignore[no-any-return]


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def _restored(kind: Any, value: Any) -> Any:
    if value is None:
        return None
    if get_origin(kind) in {Union, UnionType}:
        kind = next(one for one in get_args(kind) if one is not type(None))
    if is_dataclass(kind):
        kinds = get_type_hints(kind)
        return kind(**{name: _restored(kinds[name], item) for name, item in value.items()})  # type: ignore[operator]
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(value)
    if isinstance(value, list):
        if get_origin(kind) is np.ndarray:
            return np.array(value)
        inner = get_args(kind)[0] if get_origin(kind) is tuple and get_args(kind)[-1:] == (...,) else Any
        return tuple(_restored(inner, item) for item in value)
    return value
