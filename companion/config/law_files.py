"""A control law from a user's Python file: imported by its path, built, and tried (docs/own-law.md)."""

import importlib.machinery
import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from companion.config.toml_files import validate
from companion.control.controller import Controller, VehicleModel
from companion.control.gains import Gains
from companion.control.law_check import LawFile, check_law, raised
from companion.core.interfaces import ConfigError

LAW_FORM = "'my_law.py:MyLaw', a Python file beside this one and the class or function in it"


def is_law_file(law: object) -> bool:
    """Return True if a controller file's `law` means a Python file."""
    return isinstance(law, str) and ".py" in law


def law_path(law: str, toml: Path) -> Path:
    """Return the Python file that `law` ("my_law.py:MyLaw") in the controller file `toml` names."""
    return toml.parent / law.rpartition(":")[0]


def own_law(law: str, gains: dict[str, Any], toml: Path, vehicle: VehicleModel, period_s: float) -> Controller:
    """Return the law that `law` ("my_law.py:MyLaw") names, as MyLaw(gains, vehicle, period_s).

    `gains` is that file's table; if MyLaw's first parameter is annotated with a subclass of `Gains`, it is checked and
    handed over as such, otherwise as the dict it is. Raises ConfigError, one sentence a mistake, for whatever is wrong.
    """
    path, name = law_path(law, toml), law.rpartition(":")[2]
    if path.suffix != ".py" or not name.isidentifier():
        raise ConfigError(f"{toml}: law = {law!r}: must be {LAW_FORM}")
    file = LawFile(path, name)
    if not file.path.is_file():
        raise ConfigError(f"{toml}: law = {law!r}: there is no file {file.path}")
    module = _imported(file.path)
    make = _made_by(module, file)
    model = _gains_model(make, module, file)
    values = gains if model is None else validate(model, gains, toml, under="gains")
    return check_law(file.call("(gains, vehicle, period_s)", make, values, vehicle, period_s), file, period_s)


class _Fresh(importlib.machinery.SourceFileLoader):
    """Compiles the file as it is now: a cache cannot tell two edits within a second apart, and would litter."""

    def get_code(self, fullname: str) -> CodeType | None:
        """Compile the file; never from a cache."""
        del fullname
        return self.source_to_code(self.get_data(self.path), self.path)


def _imported(path: Path) -> ModuleType:
    """Import the file as a module under a name that no other module has."""
    name = f"{path.stem}@{path.resolve()}"
    loader = _Fresh(name, str(path))
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
