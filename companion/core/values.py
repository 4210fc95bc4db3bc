"""Decorator for values created many times in a cycle: frozen for the type checker, plain at run time."""

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

Made = TypeVar("Made")


@dataclass_transform(frozen_default=True)
def value(cls: type[Made]) -> type[Made]:
    """Make `cls` a dataclass whose fields are frozen for the type checker only.

    A frozen dataclass calls object.__setattr__ for each field when it is created, 0.1 us each: a tenth of a control
    cycle. Used for the states of filters and laws, which only type-checked code touches; values that cross an
    interface or reach a user's own law are frozen dataclasses.
    """
    return dataclass(cls)
