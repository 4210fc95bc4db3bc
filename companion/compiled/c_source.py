"""C functions from traced ones: straight-line code, every operation once, in the order in which it was written.

What a `real` is, a `truth`, a branch and a choice, is said where the code is included: of one vehicle (flight.c), or of
several side by side (batch.c).
"""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from companion.compiled.leaves import leaves, mapped
from companion.geometry.traced import Traced
from companion.geometry.traced_array import as_traced

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


def traced(
    name: str, function: Callable[..., dict[str, object]], *, fixed: Collection[str] = (), **examples: object
) -> CFunction:
    """Call a function with numbers that write down what is done to them; `examples` have the shapes of its arguments.

    It returns named values; each argument and each of these is one vector of doubles. What depends on the arguments
    `fixed` alone is worked out by a function of its own, NAME_known, whose result NAME takes as its last argument.
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
    roots = [number for _, number in stores if isinstance(number, Traced)]
    known = _known(roots, fixed) if fixed else []
    beforehand = _c_function(
        f"{name}_known", [*fixed], ["known"], _Body([(f"known[{index}]", node) for index, node in enumerate(known)])
    )
    body = _Body(stores, {node: f"known[{index}]" for index, node in enumerate(known)})
    whole = _c_function(name, [*takes, "known"] if fixed else [*takes], [*returns], body)
    returns |= {"known": [str(index) for index in range(len(known))]} if fixed else {}
    return CFunction(name, takes, returns, beforehand + whole if fixed else whole)


def _c_function(name: str, takes: list[str], returns: list[str], body: "_Body") -> str:
    vectors = [f"const real *{argument}" for argument in takes] + [f"real *{result}" for result in returns]
    return "\n".join([f"static void {name}({', '.join(vectors)})", "{", *body.lines(), "}", "", ""])


def _known(roots: list[Traced], fixed: Collection[str]) -> list[Traced]:
    """Return the numbers worth keeping that depend on fixed arguments alone, and that others need."""
    cost: dict[Traced, int] = {}
    kept: dict[Traced, None] = {}
    for node in _in_order(roots):
        parts = [part for part in node.operands if isinstance(part, Traced)]
        is_input = node.operation == "input"
        alone = node.name.split("[")[0] in fixed if is_input else all(part in cost for part in parts)
        if alone:
            cost[node] = sum(cost[part] for part in parts) + (0 if is_input else _COSTS.get(node.operation, 1))
        else:
            kept |= dict.fromkeys(part for part in parts if cost.get(part, 0) >= _KEPT)
    return [node for node in kept if node.operation not in _TRUTHS]


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
        return as_traced(inputs) if isinstance(number, np.ndarray) else inputs.item()

    return mapped(example, symbol)


Path = tuple[tuple[int, bool], ...]
"""Conditions, by their place in the order of all numbers, from the outermost, under which alone a number is needed."""


class _Blocks:
    """Conditions under which alone each number is needed, so that a branch costs nothing while it is not taken.

    A `where` whose sides are costly becomes an `if`; all of one condition become one, unless one needs another.
    """

    def __init__(self, roots: list[Traced], known: Collection[Traced]) -> None:
        self.order = _in_order(roots, known)
        self._known = known
        self.place = {node: place for place, node in enumerate(self.order)}
        self._roots = roots
        self.eager: set[Traced] = set()
        while self._settle():
            pass

    def _settle(self) -> bool:
        """Work out the paths; return True if another `where` had to become eager."""
        self.paths = self._paths()
        self.groups: dict[tuple[Path, int], list[Traced]] = {}
        for node in self.order:
            if node.operation == "where" and node not in self.eager and node not in self._known:
                self.groups.setdefault((self.paths[node], self.condition(node)), []).append(node)
        before = len(self.eager)
        for (path, condition), members in self.groups.items():
            cost = [0, 0]
            sides = [(*path, (condition, side)) for side in (False, True)]
            for node, where in self.paths.items():
                if where[: len(path) + 1] in sides:
                    cost[where[len(path)][1]] += _COSTS.get(node.operation, 1)
            self.eager |= set(members) if max(cost) < _WORTH else _dependent(members, self._known)
        return len(self.eager) > before

    def condition(self, where: Traced) -> int:
        """Return the place of what decides a `where`."""
        return self.place[where.operands[0]]  # type: ignore[index]

    def _paths(self) -> dict[Traced, Path]:
        found: dict[Traced, Path] = dict.fromkeys(self._roots, ())
        for node in reversed(self.order):
            path = found[node]
            for index, part in enumerate(() if node in self._known else node.operands):
                if not isinstance(part, Traced):
                    continue
                lazy = node.operation == "where" and index > 0 and node not in self.eager
                inner = (*path, (self.condition(node), index == 1)) if lazy else path
                found[part] = _common(found[part], inner) if part in found else inner
        return found


_KEPT = 4
"""Least cost of a number that is kept rather than worked out again."""
_WORTH = 12
"""Least cost of a side for which an `if` pays; a multiplication costs 1."""
_COSTS = {"/": 4, "sqrt": 5, "pow": 40, "norm": 40} | dict.fromkeys(
    ("sin", "cos", "tan", "atan", "atan2", "exp", "tanh"), 15
)


def _in_order(roots: list[Traced], known: Collection[Traced] = ()) -> list[Traced]:
    """Return all numbers that are needed, operands first; without recursion, as graphs are deep."""
    done: dict[Traced, None] = {}
    waiting = list(reversed(roots))
    while waiting:
        node = waiting[-1]
        parts = () if node in known else node.operands
        missing = [part for part in parts if isinstance(part, Traced) and part not in done]
        if missing:
            waiting += reversed(missing)
            continue
        done[waiting.pop()] = None
    return list(done)


def _common(a: Path, b: Path) -> Path:
    same = 0
    while same < min(len(a), len(b)) and a[same] == b[same]:
        same += 1
    return a[:same]


def _dependent(members: list[Traced], known: Collection[Traced]) -> set[Traced]:
    """Return those that need another of them."""
    own, needs = set(members), set[Traced]()
    for node in _in_order(members, known):
        if node not in known and any(
            isinstance(part, Traced) and (part in own or part in needs) for part in node.operands
        ):
            needs.add(node)
    return own & needs


class _Body:
    """Statements of a function that stores these numbers."""

    def __init__(self, stores: Sequence[tuple[str, object]], known: Mapping[Traced, str] | None = None) -> None:
        self._stores, self._known = stores, known or {}
        self._blocks = _Blocks([number for _, number in stores if isinstance(number, Traced)], self._known)
        self._by_path: dict[Path, list[Traced]] = {}
        for node in self._blocks.order:
            self._by_path.setdefault(self._blocks.paths[node], []).append(node)
        self._local: dict[Traced, str] = {}
        self._begun: set[tuple[Path, int]] = set()
        self._statements: list[str] = []

    def lines(self) -> list[str]:
        """Return the statements; all inputs are read before the first output is written: they may be one vector."""
        inputs = [node for node in self._blocks.order if node.operation == "input"]
        for node in inputs:
            self._declare(node)
        self._block(())
        return self._statements + [f"    {place} = {self._number(number)};" for place, number in self._stores]

    def _block(self, path: Path) -> None:
        for node in self._by_path.get(path, []):
            self._write(node, path)

    def _write(self, node: Traced, path: Path) -> None:
        """Write one number of a block, and first what it needs that is not written yet."""
        if node in self._local:
            return
        if node in self._known:
            self._declare(node)
            return
        if node.operation == "where" and node not in self._blocks.eager:
            self._if(self._blocks.groups[path, self._blocks.condition(node)], path)
            return
        for part in node.operands:
            if isinstance(part, Traced) and part not in self._local:
                self._write(part, path)
        self._declare(node)

    def _if(self, group: list[Traced], path: Path) -> None:
        """Write all of one condition that can be written together."""
        condition, members = self._blocks.condition(group[0]), group
        if (path, condition) in self._begun:
            raise AssertionError("conditions whose numbers need each other: make one of them eager")
        self._begun.add((path, condition))
        sides = [(*path, (condition, side)) for side in (True, False)]
        inner = [node for where, nodes in self._by_path.items() if where[: len(path) + 1] in sides for node in nodes]
        for node in members + inner:
            for part in () if node in self._known else node.operands:
                if isinstance(part, Traced) and self._blocks.paths[part] == path:
                    self._write(part, path)
        indent = "    " * (len(path) + 1)
        truth = self._truth(group[0].operands[0])
        for node in members:
            self._local[node] = f"t{len(self._local)}"
        self._statements.append(f"{indent}real {', '.join(f'{self._local[node]} = NUMBER(0.0)' for node in members)};")
        for index, (side, begin) in enumerate(zip(sides, (f"IF ({truth}) {{", f"}} ELSE ({truth}) {{"), strict=True)):
            self._statements.append(indent + begin)
            self._block(side)
            for node in members:
                name, number = self._local[node], self._number(node.operands[index + 1])
                chosen = number if side[-1][1] else f"OTHER({truth}, {name}, {number})"
                self._statements.append(f"{indent}    {name} = {chosen};")
        self._statements.append(f"{indent}}}")

    def _declare(self, node: Traced) -> None:
        kind = "truth" if node.operation in _TRUTHS else "real"
        if node in self._known:
            self._local.setdefault(node, self._known[node])
        elif node.operation != "input" and node not in self._local:
            name = f"{'c' if kind == 'truth' else 't'}{len(self._local)}"
            indent = "    " * (len(self._blocks.paths[node]) + 1)
            self._statements.append(f"{indent}const {kind} {name} = {self._expression(node)};")
            self._local[node] = name
        elif node not in self._local:
            self._local[node] = f"t{len(self._local)}"
            self._statements.append(f"    const real {self._local[node]} = {node.name};")

    def _operand(self, number: object) -> str:
        """Return an operand of + - x / or of a comparison, one of whose operands may be a plain literal."""
        return self._number(number) if isinstance(number, Traced) else _literal(float(number))  # type: ignore[arg-type]

    def _number(self, number: object) -> str:
        if not isinstance(number, Traced):
            return f"NUMBER({_literal(float(number))})"  # type: ignore[arg-type]
        return f"COUNT({self._local[number]})" if number.operation in _TRUTHS else self._local[number]

    def _truth(self, operand: object) -> str:
        if isinstance(operand, Traced) and operand.operation in _TRUTHS:
            return self._local[operand]
        return f"({self._number(operand)} != 0.0)"

    def _expression(self, node: Traced) -> str:
        operation = node.operation
        if operation in _INFIX | _COMPARED:
            return f" {operation} ".join(map(self._operand, node.operands))
        if operation in _LOGICAL:
            return f" {operation} ".join(map(self._truth, node.operands))
        parts = [self._number(part) for part in node.operands]
        if operation == "where":
            return f"CHOICE({self._truth(node.operands[0])}, {parts[1]}, {parts[2]})"
        if operation == "neg":
            return f"-{parts[0]}"
        return f"{_FUNCTIONS.get(operation, operation)}({', '.join(parts)})"


_FUNCTIONS = {"max": "larger", "min": "smaller"}


def _literal(number: float) -> str:
    if math.isnan(number):
        return "NAN"
    if math.isinf(number):
        return "INFINITY" if number > 0.0 else "-INFINITY"
    return repr(number) if number >= 0.0 and not repr(number).startswith("-") else f"({number!r})"
