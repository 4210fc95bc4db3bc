"""Values that the shell's completion offers: names of config/ and files of the current folder."""

import glob
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

Completion = Callable[..., list[str]]
"""Function of the incomplete word; of click's context before it, where its first parameter is `ctx`."""
_CURVES = ("ellipse", "figure8")


def trajectories(incomplete: str) -> list[str]:
    """Return the curves and CSV files that begin with `incomplete`."""
    return _matching(_CURVES, (".csv",), incomplete)


def controllers(incomplete: str) -> list[str]:
    """Return the control laws and TOML files that begin with `incomplete`."""
    return _matching(("etnn", *_names("controllers")), (".toml",), incomplete)


def motions(incomplete: str) -> list[str]:
    """Return the arms' motions and motion files that begin with `incomplete`."""
    return _matching(_names("arms"), (".toml", ".csv"), incomplete)


def motions_or_off(incomplete: str) -> list[str]:
    """Return the completions of `motions`, and `off`."""
    return _matching(("off", *_names("arms")), (".toml", ".csv"), incomplete)


def service_motions(incomplete: str) -> list[str]:
    """Return the names of motions that begin with `incomplete`; no files, as the service cannot read them."""
    return _matching(_names("arms"), (), incomplete)


def experiments(incomplete: str) -> list[str]:
    """Return the experiments and TOML files that begin with `incomplete`."""
    return _matching(_names("experiments"), (".toml",), incomplete)


def vehicles(ctx: Any, incomplete: str) -> list[str]:
    """Return `all`, and the vehicles online on the broker that the options before name."""
    from companion.client.roster import names_for_completion  # noqa: PLC0415 - only when TAB is pressed

    given = {name: ctx.params.get(name) for name in ("broker", "password_file", "ca_file", "config")}

    def found(last: str) -> list[str]:
        return _matching((*names_for_completion(given), *(("all",) if last == incomplete else ())), (), last)

    return listed(found)(incomplete)


def listed(one: Completion) -> Completion:
    """Return a completion of comma-separated names that completes the last one."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{word}" for word in one(last)]

    return complete


def _names(folder: str) -> list[str]:
    """Return the names in a folder of config/, without the ending."""
    from companion.config.locations import names_in  # noqa: PLC0415 - only when TAB is pressed

    return names_in(folder)


def _matching(names: tuple[str, ...] | list[str], endings: tuple[str, ...], incomplete: str) -> list[str]:
    """Return the names, files with one of `endings` and folders that begin with `incomplete`, in this order."""
    folder, begin = os.path.split(incomplete)
    found = sorted(Path(folder or ".").glob(f"{glob.escape(begin)}*")) if endings else []
    shown = [path for path in found if begin or not path.name.startswith(".")]
    paths = [os.path.join(folder, path.name) for path in shown if path.suffix in endings]  # noqa: PTH118 - as it was typed
    folders = [f"{os.path.join(folder, path.name)}/" for path in shown if path.is_dir()]  # noqa: PTH118
    return [word for word in dict.fromkeys([*names, *paths, *folders]) if word.startswith(incomplete)]
