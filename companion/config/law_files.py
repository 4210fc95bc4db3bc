"""A control law from a user's Python file: imported by its path, built, and tried (docs/own-law.md)."""

import importlib.machinery
import importlib.util
import inspect
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from companion.config.toml_files import validate
from companion.control.controller import Controller, VehicleModel
from companion.control.gains import Gains
from companion.control.law_check import LawFile, check_law, raised
from companion.core.interfaces import ConfigError

_IMPORTING = threading.Lock()
"""Held while a law is imported: threads of one process may import the same file, under the same name."""
LAW_FORM = "'my_law.py:MyLaw', a Python file beside this one and the class or function in it"


def is_law_file(law: object) -> bool:
    """Return True if a controller file's `law` means a Python file."""
    return isinstance(law, str) and ".py" in law


def law_path(law: str, toml: Path) -> Path:
    """Return the Python file that `law` ("my_law.py:MyLaw") in the controller file `toml` names."""
    return toml.parent / law.rpartition(":")[0]


def law_source(law: object, toml: Path) -> bytes | None:
    """Return the Python source that a controller file's `law` names; None without such a file. Raises ConfigError."""
    if not is_law_file(law) or not (path := law_path(str(law), toml)).is_file():
        return None
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error


def own_law(
    law: str, gains: dict[str, Any], toml: Path, source: bytes | None, vehicle: VehicleModel, period_s: float
) -> Controller:
    """Return the law that `law` ("my_law.py:MyLaw") names, as MyLaw(gains, vehicle, period_s).

    `source` is what `law_source` read, perhaps on another computer: the file is not read again.
    `gains` is that file's table; if MyLaw's first parameter is annotated with a subclass of `Gains`, it is checked and
    handed over as such, otherwise as the dict it is. Raises ConfigError, one sentence a mistake, for whatever is wrong.
    """
    path, name = law_path(law, toml), law.rpartition(":")[2]
    if path.suffix != ".py" or not name.isidentifier():
        raise ConfigError(f"{toml}: law = {law!r}: must be {LAW_FORM}")
    file = LawFile(path, name)
    if source is None:
        raise ConfigError(f"{toml}: law = {law!r}: there is no file {file.path}")
    with _IMPORTING:
        module = _imported(file.path, source)
    make = _made_by(module, file)
    model = _gains_model(make, module, file)
    values = gains if model is None else validate(model, gains, toml, under="gains")
    return check_law(file.call("(gains, vehicle, period_s)", make, values, vehicle, period_s), file, period_s)


class _Fresh(importlib.machinery.SourceFileLoader):
    """Compiles the source it is given: a cache cannot tell two edits within a second apart, and would litter."""

    def __init__(self, name: str, path: Path, source: bytes) -> None:
        super().__init__(name, str(path))
        self._source = source

    def get_code(self, fullname: str) -> CodeType | None:
        """Compile the source; never from a cache."""
        del fullname
        return self.source_to_code(self._source, self.path)


def _imported(path: Path, source: bytes) -> ModuleType:
    """Import the file's source as a module under a name that no other module has."""
    name = f"{path.stem}@{path.resolve()}"
    loader = _Fresh(name, path, source)
    module = importlib.util.module_from_spec(importlib.machinery.ModuleSpec(name, loader, origin=str(path)))
    sys.modules[name] = module  # dataclasses look there for the types of their fields
    try:
        loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise ConfigError(f"{path}: cannot be imported: {raised(error, path)}") from error
    return module


def _made_by(module: ModuleType, file: LawFile) -> Callable[..., Any]:
    """Return the class or function that makes the law from three arguments; ConfigError when there is none."""
    make = getattr(module, file.name, None)
    if make is None:
        own = sorted(
            n for n, v in vars(module).items() if callable(v) and getattr(v, "__module__", "") == module.__name__
        )
        there = f"; there are {', '.join(own)}" if own else ""
        raise ConfigError(f"{file.path}: has no class or function {file.name!r}{there}")
    try:
        inspect.signature(make).bind(None, None, None)
    except (TypeError, ValueError) as error:
        raise file.wrong(f" must be a class or function that takes (gains, vehicle, period_s): {error}") from error
    return make  # type: ignore[no-any-return]


def _gains_model(make: Callable[..., Any], module: ModuleType, file: LawFile) -> type[Gains] | None:
    """Return the model that annotates its first parameter; None for a plain table."""
    wanted = next(iter(inspect.signature(make).parameters.values())).annotation
    if isinstance(wanted, str):
        wanted = getattr(module, wanted, None)  # from __future__ import annotations
    if not isinstance(wanted, type) or wanted in (dict, inspect.Parameter.empty):
        return None
    if not issubclass(wanted, Gains):
        raise file.wrong(
            f" wants a {wanted.__name__} as gains: must be a subclass of companion.control.gains.Gains, or a dict"
        )
    return wanted
