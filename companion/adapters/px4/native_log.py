"""MAVSDK's native log redirected to ours: made safe for a terminal and rate-limited."""

import contextlib
import ctypes
import logging
from typing import Any

from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.logging import LogCallback

from companion.adapters.system.log_lines import LineLimit, printable

LOG = logging.getLogger("companion.adapters.px4.mavsdk")

_LEVELS = {0: logging.DEBUG, 1: logging.DEBUG, 2: logging.INFO, 3: logging.INFO}
"""One step quieter than MAVSDK thinks: what matters to the operator comes as an exception."""
_OURS = "Received ack for not-existing command"
"""Logged for every command that we send without MAVSDK."""


_LIMIT = LineLimit()


def _take(level: int, message: bytes | None, _file: bytes | None, _line: int, _data: Any) -> bool:
    """Log one message; True: MAVSDK need not print it. Its own Python wrapper fails on bytes that are no UTF-8."""
    with contextlib.suppress(Exception):  # without memory nothing can be said, and MAVSDK must not begin to print
        text = printable((message or b"").decode("utf-8", "replace"))
        if not text.startswith(_OURS):
            _LIMIT.log(lambda more: LOG.log(_LEVELS.get(level, logging.INFO), "%s%s", text, more))
    return True


_CALLBACK = LogCallback(_take)
"""Kept for as long as the process lives: MAVSDK's threads may say something at any time."""


def take_native_log() -> None:
    """Have MAVSDK's messages logged from now on instead of printed to standard output."""
    _cmavsdk_lib.mavsdk_log_subscribe(_CALLBACK, ctypes.c_void_p(None))
