"""What MAVSDK's native library says, into our log: harmless to a terminal, and not more than a log can bear."""

import contextlib
import ctypes
import logging
import time
from collections.abc import Callable
from typing import Any

from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.logging import LogCallback

from companion.adapters.px4.texts import printable

LOG = logging.getLogger("companion.adapters.px4.mavsdk")

_LEVELS = {0: logging.DEBUG, 1: logging.DEBUG, 2: logging.INFO, 3: logging.INFO}
"""One step quieter than MAVSDK thinks: what matters to the operator comes as an exception."""
_MOST, _WINDOW_S = 20, 10.0
"""Lines in a time; more are counted."""
_OURS = "Received ack for not-existing command"
"""Said of every command of ours, which MAVSDK does not know of."""


class LineLimit:
    """Lets a number of lines through in each window of time, and then says how many there were beside them."""

    def __init__(self, most: int, window_s: float) -> None:
        self._most, self._window_s = most, window_s
        self._begun_s, self._passed, self._dropped = -float("inf"), 0, 0

    def take(self, now_s: float) -> int | None:
        """Return how many were dropped before this line, or None when it is to be dropped, too."""
        if now_s - self._begun_s > self._window_s:
            self._begun_s, self._passed = now_s, 0
        if self._passed >= self._most:
            self._dropped += 1
            return None
        self._passed += 1
        dropped, self._dropped = self._dropped, 0
        return dropped


_LIMIT = LineLimit(_MOST, _WINDOW_S)


def _take(level: int, message: bytes | None, _file: bytes | None, _line: int, _data: Any) -> bool:
    """Log one message; True: MAVSDK need not print it. Its own Python wrapper fails on bytes that are no UTF-8."""
    with contextlib.suppress(Exception):  # without memory nothing can be said, and MAVSDK must not begin to print
        text = printable((message or b"").decode("utf-8", "replace"))
        if not text.startswith(_OURS):
            log_limited(_LIMIT, lambda more: LOG.log(_LEVELS.get(level, logging.INFO), "%s%s", text, more))
    return True


def log_limited(limit: LineLimit, log: Callable[[str], None]) -> None:
    """Call `log` with the end of the line, a count of those left out, unless there are too many lines."""
    dropped = limit.take(time.monotonic())
    if dropped is not None:
        log(f" ({dropped} lines before this one are left out)" if dropped else "")


_CALLBACK = LogCallback(_take)
"""Kept for as long as the process lives: MAVSDK's threads may say something at any time."""


def take_native_log() -> None:
    """Have MAVSDK's messages logged from now on instead of printed to standard output."""
    _cmavsdk_lib.mavsdk_log_subscribe(_CALLBACK, ctypes.c_void_p(None))
