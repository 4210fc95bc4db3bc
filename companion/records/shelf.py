"""The folder of records: names, what must go, and whether there is room."""

import errno
import io
import logging
import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from companion.config_records import RecordsConfig

LOG = logging.getLogger(__name__)

NAME = re.compile(r"^\d{8}-\d{6}-[A-Za-z0-9_-]+\.mcap$")
"""Only files that are named so are ours to delete."""
_WRITTEN_S = 60.0
"""What was written to so lately may be another vehicle's flight."""


@dataclass(frozen=True)
class Shelf:
    """One vehicle's records; several vehicles may share a folder."""

    config: RecordsConfig
    vehicle: str

    @property
    def folder(self) -> Path:
        """Where they are."""
        return Path(self.config.folder)

    def new_path(self, unix_s: float) -> Path:
        """A name that is not taken; makes the folder. OSError when it cannot."""
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = f"{datetime.fromtimestamp(unix_s, UTC).astimezone():%Y%m%d-%H%M%S}-{self.vehicle}"
        path, again = self.folder / f"{stem}.mcap", 1
        while path.exists():
            again += 1
            path = self.folder / f"{stem}-{again}.mcap"
        return path

    def free_mb(self) -> float:
        """What may be filled of the disk, MB; 0 where it cannot be asked."""
        there = self.folder.absolute()
        while not there.exists():
            there = there.parent
        try:
            disk = os.statvfs(there)
        except OSError:
            return 0.0
        return disk.f_bavail * disk.f_frsize * 1e-6

    def has_room(self) -> bool:
        """Whether a flight may be written."""
        return self.free_mb() >= self.config.min_free_mb

    def rotate(self, writing: Path | None = None, now_s: float | None = None) -> list[Path]:
        """Delete the oldest flights until size and age are kept, never the one being written; what went."""
        now_s = time.time() if now_s is None else now_s
        found = []
        for path in self.folder.glob("*.mcap"):
            if NAME.match(path.name) and path != writing:
                there = path.stat()
                found.append((there.st_mtime, there.st_size, path))
        found.sort()
        total = sum(size for _, size, _ in found) + (writing.stat().st_size if writing is not None else 0)
        gone = []
        for written_s, size, path in found:
            too_old = now_s - written_s > 86400.0 * self.config.keep_days
            if not (too_old or total > 1e6 * self.config.keep_mb) or now_s - written_s < _WRITTEN_S:
                continue
            path.unlink(missing_ok=True)
            total -= size
            gone.append(path)
        return gone


class Unbreakable(io.FileIO):
    """A new file that takes all it is given: what the disk refuses is dropped from there on, and told once.

    So what is in the file stays readable, and whoever writes need not know.
    """

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        super().__init__(path, "x+")
        self._tell = tell
        self.broken = False

    def write(self, data: object) -> int:
        """All of it, or as good as that."""
        view = memoryview(data)  # type: ignore[arg-type]
        left = view.nbytes
        while left and not self.broken:
            try:
                left -= super().write(view[view.nbytes - left :])
            except OSError as error:
                self.broken = True
                full = error.errno in {errno.ENOSPC, errno.EDQUOT}
                self._tell("the disk is full" if full else f"the disk refuses: {error.strerror}")
        return view.nbytes
