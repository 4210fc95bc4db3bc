"""Free disk space for records, asked on a thread: a network disk that is gone never answers."""

import logging
import math
import os
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

LOG = logging.getLogger(__name__)

_PATIENCE_PERIODS = 3.0


class DiskWatch:
    """A context manager; asks every `period_s` while it is open. `folder` need not be there yet; None: no records."""

    def __init__(self, folder: Path | None, period_s: float) -> None:
        self._folder, self._period_s = folder, period_s
        self._free_mb = math.inf
        self._answered_s = time.monotonic()
        self._closed = threading.Event()

    def __enter__(self) -> Self:
        if self._folder is not None:
            # a daemon that is never joined: it may hang in a read for ever
            threading.Thread(target=self._watch, args=(self._folder,), name="disk-watch", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closed.set()

    def free_mb(self) -> float:
        """Return the last known free space, MB; never waits. Infinite without a folder.

        0 when the disk gives an error, or has not answered for three periods: no record can be written there either.
        """
        silent_s = time.monotonic() - self._answered_s
        if self._folder is not None and silent_s > _PATIENCE_PERIODS * self._period_s:
            return 0.0
        return self._free_mb

    def _watch(self, folder: Path) -> None:
        while not self._closed.is_set():
            try:
                mb = free_mb(folder)
            except OSError as error:
                if self._free_mb > 0.0:
                    LOG.warning("the disk of %s cannot be asked for its free space: %s", folder, error)
                mb = 0.0
            self._free_mb, self._answered_s = mb, time.monotonic()
            self._closed.wait(self._period_s)


def free_mb(folder: Path) -> float:
    """Return the free space, MB, of the disk that holds the folder, or will when it is created."""
    there = folder.absolute()
    while not there.exists():
        there = there.parent
    disk = os.statvfs(there)
    return disk.f_bavail * disk.f_frsize * 1e-6
