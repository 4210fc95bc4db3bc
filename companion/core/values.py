"""Decorator for values created many times in a cycle: frozen for the type checker, plain at run time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar, dataclass_transform, overload

Made = TypeVar("Made")


@overload
def value(cls: type[Made]) -> type[Made]: ...
@overload
def value(*, kw_only: bool) -> Callable[[type[Made]], type[Made]]: ...
@dataclass_transform(frozen_default=True)
def value(cls: type[Made] | None = None, *, kw_only: bool = False) -> type[Made] | Callable[[type[Made]], type[Made]]:
    """Make `cls` a dataclass whose fields are frozen for the type checker only.

    A frozen dataclass calls object.__setattr__ for each field when it is created, 0.1 us each: a tenth of a control
    cycle. Used for the states of filters and laws, which only type-checked code touches; values that cross an
    interface or reach a user's own law are frozen dataclasses.
    """
    return dataclass(cls, kw_only=kw_only) if cls is not None else dataclass(kw_only=kw_only)
