"""Files and folders of results, checked before the work that fills them."""

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from companion.core.errors import ConfigError

_TRIAL_BYTES = 65536
"""A full disk still takes the name of a file."""


def check_output(out: Path | None, summary: Path | None) -> None:
    """Make the folders of `--out` and `--summary`, and try to write; ConfigError when one cannot be written to."""
    if out is not None:
        _check_folder(out)
    if summary is not None:
        check_file(summary, "summary")


def check_folder_of(file: Path, option: str) -> None:
    """Raise ConfigError when the folder that `--option` names does not exist: it may be a typing error."""
    if not file.parent.is_dir():
        raise ConfigError(f"--{option} {file}: there is no folder {file.parent}: make it first, or give another path")


def check_file(file: Path, option: str) -> None:
    """Make the folder of the file that `--option` names, and try to write; existing content stays.

    Raises ConfigError when it cannot be written to.
    """
    if file.is_dir():
        raise ConfigError(f"--{option} {file} is a folder: give the name of a file")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        was_there = file.exists()
        with file.open("a", encoding="utf-8"):
            pass
        if not was_there:
            file.unlink()
    except OSError as error:
        raise _refused(file, error) from error


def _check_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as trial:
            trial.write(bytes(_TRIAL_BYTES))
            trial.flush()
    except OSError as error:
        raise _refused(folder, error) from error


def kept(path: Path, write: Callable[[Path], None]) -> str:
    """Write a result; return why that failed as a sentence, with no partial file left, or an empty string."""
    try:
        write(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
        return str(_refused(path, error))
    return ""


def as_typed() -> str:
    """Return how this shell calls `companion`: by its name when it is on the PATH, else the path as typed."""
    called, found = Path(sys.argv[0]), shutil.which("companion")
    if called.name != "companion" or not called.exists() or (found and called.samefile(found)):
        return "companion"
    here = Path.cwd()
    return str(called.relative_to(here) if called.is_relative_to(here) else called)


def _refused(path: Path, error: OSError) -> ConfigError:
    return ConfigError(f"cannot write to {path}: {error.strerror or error}")
