"""Progress on standard error while a command works; standard output is for results only."""

import math
import sys
import time
from contextlib import AbstractContextManager

_SHOW_AFTER_S = 0.5
_REFRESH_S = 0.1


def working(what: str) -> AbstractContextManager[object]:
    """Show a spinner and `what` on a terminal until the block ends."""
    from rich.console import Console  # noqa: PLC0415

    return Console(stderr=True).status(what)


class Counted:
    """Progress on standard error for work of more than half a second: a live line on a terminal, else one line."""

    def __init__(self, what: str) -> None:
        self._what, self._write = what, sys.stderr.write
        self._begun_s = time.monotonic()
        self._live, self._shown_s = sys.stderr.isatty(), math.inf

    def __enter__(self) -> "Counted":
        return self

    def __exit__(self, *_: object) -> None:
        if self._live and self._shown_s < math.inf:
            self._write("\r\x1b[K")

    def __call__(self, done: int, of: int) -> None:
        """Show that `done` of `of` parts are finished."""
        now_s = time.monotonic()
        if now_s - self._begun_s < _SHOW_AFTER_S:
            return
        if self._live and (self._shown_s == math.inf or now_s - self._shown_s > _REFRESH_S):
            self._write(f"\r{self._what}: {done} of {of}\x1b[K")
            self._shown_s = now_s
        elif not self._live and self._shown_s == math.inf:
            self._write(f"companion: {self._what}: {done} of {of} so far; finished parts are kept for the next run\n")
            self._shown_s = now_s
        sys.stderr.flush()
