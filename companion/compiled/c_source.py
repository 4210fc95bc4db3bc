"""C functions from traced ones: straight-line code, every operation once, in the order in which it was written."""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from companion.compiled.leaves import leaves, mapped
from companion.geometry.traced import Traced

_INFIX = {"+", "-", "*", "/"}
_COMPARED = {"<", "<=", ">", ">=", "==", "!="}
_LOGICAL = {"&", "|", "^"}
_TRUTHS = _COMPARED | _LOGICAL | {"isfinite"}


@dataclass(frozen=True)
class CFunction:
    """C function, and the layout of the vectors that it takes and returns."""

    name: str
    takes: dict[str, list[str]]
    """Paths of the numbers in each argument."""
    returns: dict[str, list[str]]
    source: str

    @property
    def layout(self) -> str:
        """Return C constants: where each vector begins in an argument, and the sizes of all."""
        return "\n".join(_constants(self.name, name, paths) for name, paths in (self.takes | self.returns).items())


def _constants(function: str, argument: str, paths: list[str]) -> str:
    places: dict[str, int] = {}
    for index, path in enumerate(paths):
        places.setdefault(re.sub(r"((^|\.)\d+|\[\d+\])+$", "", path).replace(".", "_"), index)
    named = [f"{function}_{argument}_{path} = {index}" for path, index in places.items() if path]
    return f"enum {{ {', '.join([*named, f'{function}_{argument}_size = {len(paths)}'])} }};"


def traced(name: str, function: Callable[..., dict[str, object]], **examples: object) -> CFunction:
    """Call a function with numbers that write down what is done to them; `examples` have the shapes of its arguments.

    It returns named values; each argument and each of these is one vector of doubles.
    """
    Traced.forget()
    takes = {argument: _names(example) for argument, example in examples.items()}
    returned = function(**{argument: _symbols(argument, example) for argument, example in examples.items()})
    results = {result: [*_numbers(value)] for result, value in returned.items()}
    returns = {result: [path for path, _ in numbers] for result, numbers in results.items()}
    stores = [
        (f"{result}[{index}]", number)
        for result, numbers in results.items()
        for index, (_, number) in enumerate(numbers)
    ]
    vectors = [f"const double *{argument}" for argument in takes] + [f"double *{result}" for result in returns]
    body = _Body(stores).lines()
    source = "\n".join([f"static void {name}({', '.join(vectors)})", "{", *body, "}", ""])
    return CFunction(name, takes, returns, source)


def _names(example: object) -> list[str]:
    return [path for path, _ in _numbers(example)]


def _numbers(value: object) -> Iterator[tuple[str, object]]:
    for path, number in leaves(value):
        array = np.asarray(number, dtype=object)
        for index, element in np.ndenumerate(array):
            yield path + "".join(f"[{i}]" for i in index), element


def _symbols(argument: str, example: object) -> object:
    """Return the example with an input in place of every number."""
    count = 0

    def symbol(_: str, number: object) -> object:
        nonlocal count
        array = np.asarray(number)
        inputs = np.empty(array.shape, dtype=object)
        for index in np.ndindex(array.shape):
            inputs[index] = Traced.of("input", name=f"{argument}[{count}]")
            count += 1
        return inputs if isinstance(number, np.ndarray) else inputs.item()

    return mapped(example, symbol)


class _Body:
    """Statements of a function that stores these numbers."""

    def __init__(self, stores: list[tuple[str, object]]) -> None:
        self._stores = stores
        self._local: dict[Traced, str] = {}
        self._statements: list[str] = []

    def lines(self) -> list[str]:
        """Return the statements; all inputs are read before the first output is written: they may be one vector."""
        stores = [f"    {place} = {self._operand(number)};" for place, number in self._stores]
        return self._statements + stores

    def _operand(self, number: object) -> str:
        if not isinstance(number, Traced):
            return _literal(float(number))  # type: ignore[arg-type]
        self._emit(number)
        return self._local[number]

    def _emit(self, root: Traced) -> None:
        """Write all that a number needs, without recursion: graphs are deep."""
        waiting = [root]
        while waiting:
            node = waiting[-1]
            missing = [part for part in node.operands if isinstance(part, Traced) and part not in self._local]
            if missing:
                waiting += missing
                continue
            waiting.pop()
            if node not in self._local:
                kind = "int" if node.operation in _TRUTHS else "double"
                self._local[node] = f"{'c' if kind == 'int' else 't'}{len(self._local)}"
                self._statements.append(f"    const {kind} {self._local[node]} = {self._expression(node)};")

    def _expression(self, node: Traced) -> str:
        operation = node.operation
        if operation == "input":
            return node.name
        parts = [self._local[part] if isinstance(part, Traced) else _literal(part) for part in node.operands]
        if operation in _INFIX | _COMPARED:
            return f"{parts[0]} {operation} {parts[1]}"
        if operation in _LOGICAL:
            return f" {operation} ".join(map(_truth, node.operands, parts))
        if operation == "where":
            return f"{_truth(node.operands[0], parts[0])} ? {parts[1]} : {parts[2]}"
        if operation == "neg":
            return f"-{parts[0]}"
        return f"{_FUNCTIONS.get(operation, operation)}({', '.join(parts)})"


_FUNCTIONS = {"max": "larger", "min": "smaller"}


def _truth(operand: object, text: str) -> str:
    is_truth = isinstance(operand, Traced) and operand.operation in _TRUTHS
    return text if is_truth else f"({text} != 0.0)"


def _literal(number: float) -> str:
    if math.isnan(number):
        return "NAN"
    if math.isinf(number):
        return "INFINITY" if number > 0.0 else "-INFINITY"
    return repr(number) if number >= 0.0 and not repr(number).startswith("-") else f"({number!r})"
