"""Options that a group of commands shares, added to each command's own."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any, get_args

Group = Mapping[str, Any]
"""Annotated types of the shared parameters, by name; flags default to False, all others to None."""


def with_group(
    command: Callable[..., None], group: Group, collect: Callable[..., Any], about: str = ""
) -> Callable[..., None]:
    """Return `command` with its own parameters and those of `group`, as typer reads them from the signature.

    The first parameter of `command` is what `collect` makes of the group's values; `about` is added to its docstring.
    """
    own = list(inspect.signature(command).parameters.values())[1:]
    shared = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=_default(kind))
        for name, kind in group.items()
    ]
    together = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in (*own, *shared)]

    def called(**given: Any) -> None:
        command(collect(**{name: given.pop(name) for name in group}), **given)

    called.__signature__ = inspect.Signature(together)  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in together}
    called.__name__, called.__doc__ = command.__name__, f"{inspect.getdoc(command)}\n\n{about}".strip()
    return called


def _default(kind: Any) -> bool | None:
    return False if get_args(kind)[0] is bool else None
