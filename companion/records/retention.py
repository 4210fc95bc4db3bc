"""Folder of records: file names, deletion of old records, free space."""

import contextlib
import errno
import io
import logging
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from companion.adapters.system.disk import free_mb
from companion.config.records_config import RecordsConfig

LOG = logging.getLogger(__name__)

NAME = re.compile(r"^\d{8}-\d{6}-[A-Za-z0-9_-]+\.mcap$")
"""Only files that are named so are ours to delete."""
ORDER = ".records-order"
"""In the folder: names of its records in the order in which they were begun, whatever the clock said."""
KEPT = 10
"""The newest records, that no age deletes."""
_WRITTEN_S = 60.0
"""Files written to more recently may be the flight of another vehicle."""
_CLOCK_SET_S = datetime(2025, 1, 1, tzinfo=UTC).timestamp()
"""This software is younger: a clock that said less had not been set."""
_PAUSE_S = 180 * 86400.0
"""A pause between two flights that is believed, however soon records are to go."""


@dataclass(frozen=True)
class Retention:
    """Retention of one vehicle's records; several vehicles may share a folder."""

    config: RecordsConfig
    vehicle: str

    @property
    def folder(self) -> Path:
        """Folder that holds the records."""
        return Path(self.config.folder)

    def new_path(self, unix_s: float, part: str = "") -> Path:
        """Return an unused file path, ending with `part`, and create the folder; OSError when that fails."""
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = f"{datetime.fromtimestamp(unix_s, UTC).astimezone():%Y%m%d-%H%M%S}-{self.vehicle}"
        stem = f"{stem}-{part}" if part else stem
        path, again = self.folder / f"{stem}.mcap", 1
        while path.exists():
            again += 1
            path = self.folder / f"{stem}-{again}.mcap"
        return path

    def has_room(self) -> bool:
        """Return True when there is enough free space to record a flight; False where it cannot be read."""
        try:
            return free_mb(self.folder) >= self.config.min_free_mb
        except OSError:
            return False

    def rotate(self, writing: Path | None = None, now_s: float | None = None) -> list[Path]:
        """Delete the oldest flights until size and age are kept, never the one being written; return what went.

        Which are the oldest is told by the order in which they were begun, see `begun_order`: a clock may be wrong.
        """
        now_s = time.time() if now_s is None else now_s
        records = self._records(writing)
        total = sum(record.size for record in records) + _size(writing)
        too_old = _too_old(records, now_s, 86400.0 * self.config.keep_days)
        gone = []
        for number, record in enumerate(records):
            too_much = total > 1e6 * self.config.keep_mb and number < len(records) - 1
            if not (record in too_old or too_much) or abs(now_s - record.written_s) < _WRITTEN_S:
                continue
            try:
                record.path.unlink(missing_ok=True)
            except OSError as error:
                LOG.warning("%s cannot be deleted: %s", record.path, error.strerror)
                continue
            total -= record.size
            gone.append(record.path)
        return gone

    def _records(self, writing: Path | None) -> list["_Record"]:
        """Return all records but the one being written, the one begun first at the beginning."""
        found: dict[str, _Record] = {}
        for path in self.folder.glob("*.mcap"):
            if NAME.match(path.name) and path != writing:
                with contextlib.suppress(FileNotFoundError):
                    there = path.stat()
                    found[path.name] = _Record(path, there.st_mtime, there.st_size)
        by_clock = sorted(found, key=lambda name: (found[name].written_s, name))
        names = begun_order(self.folder, [*by_clock, *([writing.name] if writing is not None else [])])
        return [found[name] for name in names if name in found]


@dataclass(frozen=True)
class _Record:
    path: Path
    written_s: float
    """Unix time, by whatever clock the computer had then."""
    size: int


def _too_old(records: Sequence[_Record], now_s: float, keep_s: float) -> set[_Record]:
    """Return what was written longer ago than `keep_s`, as far as clocks can be believed.

    Never one of the newest: the clock may be ahead. Going back from now, nothing behind a pause that is longer than
    `keep_s`: it may have been no pause, but a clock that was set. Nothing that was written while the clock was not set.
    """
    later_s, too_old = now_s, set()
    for number, record in enumerate(reversed(records)):
        if not _CLOCK_SET_S <= record.written_s <= later_s:
            continue
        if later_s - record.written_s > max(keep_s, _PAUSE_S):
            break
        later_s = record.written_s
        if number >= KEPT and now_s - record.written_s > keep_s:
            too_old.add(record)
    return too_old


def begun_order(folder: Path, names: Sequence[str]) -> list[str]:
    """Return the names in the order in which they were first seen here, new ones last; note it in the folder."""
    noted = folder / ORDER
    try:
        known = dict.fromkeys(noted.read_text(encoding="utf-8", errors="replace").splitlines())
    except OSError:
        known = {}
    there = set(names)
    order = [*(name for name in known if name in there), *(name for name in names if name not in known)]
    if order != list(known) and len(order) > 1:
        with contextlib.suppress(OSError):  # then the clock's order has to do the next time
            unfinished = noted.with_suffix(".new")
            unfinished.write_text("".join(f"{name}\n" for name in order), encoding="utf-8")
            unfinished.replace(noted)
    return order


def _size(writing: Path | None) -> int:
    return writing.stat().st_size if writing is not None and writing.exists() else 0


class Unbreakable(io.FileIO):
    """New file that stays readable: after the first disk error the rest is dropped and reported once."""

    def __init__(self, path: Path, report: Callable[[str], None]) -> None:
        super().__init__(path, "x+")
        self._report = report
        self.broken = False

    def write(self, data: object) -> int:
        """Write the data, or drop it after a disk error; returns the full length."""
        view = memoryview(data)  # type: ignore[arg-type]
        left = view.nbytes
        while left and not self.broken:
            try:
                left -= super().write(view[view.nbytes - left :])
            except OSError as error:
                self.broken = True
                full = error.errno in {errno.ENOSPC, errno.EDQUOT}
                self._report("the disk is full" if full else f"the disk refuses: {error.strerror}")
        return view.nbytes
