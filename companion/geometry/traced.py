"""Numbers that write down what is done to them, so that formulas become straight-line code in another language.

A formula of floats, called once with these, leaves the graph of its operations: the same ones in the same order, hence
the same numbers to the last bit. Equal operations on equal numbers are one node. Branches on data do not exist: a
formula says `where`, and both sides are written down (`array_math`).
"""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import SupportsFloat

import numpy as np


class Traced:
    """Number known by how it was computed: an operation and its operands, or an input and its name."""

    __slots__ = ("__weakref__", "name", "operands", "operation")
    _known: "dict[tuple[object, ...], Traced]" = {}  # noqa: RUF012 - one table for all numbers is the purpose

    operation: str
    operands: "tuple[Traced | float, ...]"
    name: str

    @classmethod
    def of(cls, operation: str, *operands: object, name: str = "") -> "Traced":
        """Return the node of this operation; the one that exists if it has been asked for before."""
        parts = tuple(_operand(operand) for operand in operands)
        key = (operation, name, *(id(part) if isinstance(part, Traced) else part.hex() for part in parts))
        node = cls._known.get(key)
        if node is None:
            node = cls._known[key] = cls()
            node.operation, node.operands, node.name = operation, parts, name
        return node

    @classmethod
    def forget(cls) -> None:
        """Forget all nodes: the next trace begins with none."""
        cls._known.clear()

    @property
    def maths(self) -> SimpleNamespace:
        """The functions for this number."""
        return TRACED_MATHS

    def where(self, if_true: object, if_false: object) -> "Traced":
        """Return `if_true` where this holds, else `if_false`."""
        return Traced.of("where", self, if_true, if_false)

    def sqrt(self) -> "Traced":
        """Return the root; numpy calls this for a number that is an object."""
        return Traced.of("sqrt", self)

    def __bool__(self) -> bool:
        raise TypeError("a traced number has no value to branch on: say `where`")

    def __iter__(self) -> Iterator[float]:
        raise TypeError("a traced number is no vector")

    def __add__(self, other: object) -> "Traced":
        return _of("+", self, other)

    def __radd__(self, other: object) -> "Traced":
        return _of("+", other, self)

    def __sub__(self, other: object) -> "Traced":
        return _of("-", self, other)

    def __rsub__(self, other: object) -> "Traced":
        return _of("-", other, self)

    def __mul__(self, other: object) -> "Traced":
        return _of("*", self, other)

    def __rmul__(self, other: object) -> "Traced":
        return _of("*", other, self)

    def __truediv__(self, other: object) -> "Traced":
        return _of("/", self, other)

    def __rtruediv__(self, other: object) -> "Traced":
        return _of("/", other, self)

    def __pow__(self, other: object) -> "Traced":
        return _of("pow", self, other)

    def __neg__(self) -> "Traced":
        return Traced.of("neg", self)

    def __abs__(self) -> "Traced":
        return Traced.of("fabs", self)

    def __lt__(self, other: object) -> "Traced":
        return _of("<", self, other)

    def __le__(self, other: object) -> "Traced":
        return _of("<=", self, other)

    def __gt__(self, other: object) -> "Traced":
        return _of(">", self, other)

    def __ge__(self, other: object) -> "Traced":
        return _of(">=", self, other)

    def __eq__(self, other: object) -> "Traced":  # type: ignore[override]
        return _of("==", self, other)

    def __ne__(self, other: object) -> "Traced":  # type: ignore[override]
        return _of("!=", self, other)

    __hash__ = object.__hash__

    def __and__(self, other: object) -> "Traced":
        return _of("&", self, other)

    def __or__(self, other: object) -> "Traced":
        return _of("|", self, other)

    def __xor__(self, other: object) -> "Traced":
        return _of("^", self, other)

    __rand__, __ror__, __rxor__ = __and__, __or__, __xor__


def _of(operation: str, first: object, second: object) -> Traced:
    """Return the node of an operation on two numbers; arrays do theirs element by element, by themselves."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return NotImplemented  # type: ignore[no-any-return]
    return Traced.of(operation, first, second)


def _operand(value: object) -> "Traced | float":
    if isinstance(value, Traced):
        return value
    if isinstance(value, SupportsFloat):
        return float(value)
    raise TypeError(f"{value!r} is no number")


def _named(name: str) -> Callable[..., Traced]:
    return lambda *operands: Traced.of(name, *operands)


_NAMES = ("sqrt", "sin", "cos", "tan", "atan", "atan2", "exp", "expm1", "tanh", "copysign", "isfinite")
TRACED_MATHS = SimpleNamespace(**{name: _named(name) for name in _NAMES})
"""Functions that `math` has for floats, for traced numbers."""
