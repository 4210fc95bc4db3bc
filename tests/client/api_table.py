"""Tables of docs/python.md, from the code: `python -m tests.client.api_table` prints them."""

import inspect
from collections.abc import Callable, Iterator
from typing import Any

from companion.client import connecting
from companion.client.vehicle import Arms, Vehicle
from companion.client.view import VehicleView

_NOT_FOR_SCRIPTS = {"execute", "carry_out"}
"""Methods for the command line."""


def first_line(item: object) -> str:
    """Return the first paragraph of a docstring on one line."""
    text = inspect.getdoc(item)
    assert text is not None
    return " ".join(text.split("\n\n")[0].split()).replace("|", "\\|")


def call(name: str, function: Callable[..., Any]) -> str:
    """Return a function with its parameters and defaults, without types; `timeout_s` is every command's."""
    parameters = inspect.signature(function).parameters.values()
    shown = [one for one in parameters if one.name not in {"self", "timeout_s"}]
    bare = [one.replace(annotation=inspect.Parameter.empty) for one in shown]
    return f"{name}{inspect.Signature(bare)}"


def methods(kind: type, prefix: str = "") -> Iterator[str]:
    """Return a row for each public method."""
    for name, method in vars(kind).items():
        if inspect.isfunction(method) and not name.startswith("_") and name not in _NOT_FOR_SCRIPTS:
            yield f"| `{call(prefix + name, method)}` | {first_line(method)} |"


def rows() -> list[str]:
    """Return the rows of all tables that name parts of the client."""
    functions = (connecting.connect, connecting.connect_all, connecting.vehicles, connecting.together)
    properties = [(name, one) for name, one in vars(VehicleView).items() if isinstance(one, property)]
    return [
        *(f"| `{call(function.__name__, function)}` | {first_line(function)} |" for function in functions),
        *methods(Vehicle),
        *methods(Arms, "arms."),
        *methods(VehicleView),
        *(f"| `{name}` | {first_line(one)} |" for name, one in properties),
    ]


if __name__ == "__main__":
    print("\n".join(rows()))
