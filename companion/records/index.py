"""The lines of all records in a folder, kept in a file there, so that only new and changed records are looked into."""

import contextlib
import json
import math
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from companion.records.errors import RecordError
from companion.records.flight_summary import FlightSummary, summarize_flight, unreadable

NAME = ".records-index.json"
"""In the folder of records. Only a shortcut: it is rewritten where it is missing, damaged or of another version."""
_VERSION = 1
_KINDS: dict[str, type] = {
    "begin_s": float, "length_s": float, "law": str, "ended": str, "size_mb": float, "truncated": bool,
    "unreadable": str,
}  # fmt: skip
_Lines = dict[str, dict[str, Any]]
Progress = Callable[[int, int], None]
"""Called with how many of how many records were looked into."""


def flight_summaries(folder: Path, progress: Progress | None = None) -> list[FlightSummary]:
    """Return the lines of all records in a folder, the newest last; those of unreadable files say why they are.

    A record that vanishes meanwhile is left out. Raises OSError where the folder cannot be listed.
    """
    known = _load(folder)
    stamps = _stamps(folder)
    found = {name: _restored(folder / name, known[name]) for name in stamps if _is_same(known.get(name), stamps[name])}
    new = [name for name in stamps if found.get(name) is None]
    for done, name in enumerate(new):
        if progress is not None:
            progress(done, len(new))
        found[name] = _looked_into(folder / name)
    lines = {name: line for name, line in found.items() if line is not None}
    if new or lines.keys() != known.keys():
        _save(folder, {name: _kept(line, stamps[name]) for name, line in lines.items()})
    return sorted(lines.values(), key=lambda line: _order(line, stamps[line.path.name]))


def _stamps(folder: Path) -> dict[str, tuple[int, int]]:
    """Return size and time of the last change (ns) of what could be a record."""
    stamps = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.endswith((".mcap", ".npz")) and not entry.name.startswith("."):
                with contextlib.suppress(FileNotFoundError):
                    there = entry.stat(follow_symlinks=False)
                    stamps[entry.name] = (there.st_size, there.st_mtime_ns)
    return stamps


def _looked_into(path: Path) -> FlightSummary | None:
    try:
        return summarize_flight(path)
    except RecordError as error:
        return unreadable(path, str(error)) if os.path.lexists(path) else None


def _order(line: FlightSummary, stamp: tuple[int, int]) -> tuple[float, str]:
    begin_s = line.begin_s if math.isfinite(line.begin_s) else 1e-9 * stamp[1] - max(0.0, line.length_s or 0.0)
    return (begin_s if math.isfinite(begin_s) else 1e-9 * stamp[1], line.path.name)


def _load(folder: Path) -> _Lines:
    try:
        data = json.loads((folder / NAME).read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(data, dict) or data.get("version") != _VERSION or not isinstance(data.get("records"), dict):
        return {}
    return {name: line for name, line in data["records"].items() if isinstance(line, dict)}


def _save(folder: Path, lines: _Lines) -> None:
    """Replace the index in one step; a read-only folder has none."""
    text = json.dumps({"version": _VERSION, "records": lines})
    with contextlib.suppress(OSError), tempfile.NamedTemporaryFile("w", dir=folder, prefix=NAME, delete=False) as file:
        try:
            file.write(text)
            file.close()
            Path(file.name).chmod(0o644)
            Path(file.name).replace(folder / NAME)
        except OSError:
            Path(file.name).unlink(missing_ok=True)
            raise


def _is_same(line: dict[str, Any] | None, stamp: tuple[int, int]) -> bool:
    return line is not None and line.get("stamp") == [*stamp]


def _kept(line: FlightSummary, stamp: tuple[int, int]) -> dict[str, Any]:
    """Return the line as JSON values; a file that could not be opened gets no stamp, so that it is read again."""
    values = asdict(line)
    del values["path"]
    return values | {"stamp": [*stamp] if "cannot be read" not in line.unreadable else None}


def _restored(path: Path, line: dict[str, Any]) -> FlightSummary | None:
    values: dict[str, Any] = {name: line.get(name) for name in _KINDS}
    if any(not isinstance(value, _KINDS[name]) for name, value in values.items()):
        return None
    return FlightSummary(path=path, **values)
