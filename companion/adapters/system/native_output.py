"""Capture of output that native libraries and the interpreter write past the log while the service runs."""

import contextlib
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from companion.adapters.system.log_lines import LineLimit, printable

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

LOG = logging.getLogger(__name__)

_STDOUT = 1
_LONGEST = 4096
"""A line without an end is cut here."""


@contextlib.contextmanager
def standard_output_to_log() -> Iterator[None]:
    """Log every line that reaches standard output from any source; a log that cannot keep up loses lines.

    Standard error stays as it is: a process that crashes still writes there why.
    """
    sys.stdout.flush()
    reading, writing = os.pipe()
    os.set_blocking(writing, False)  # a thread of MAVSDK that prints must never wait for us
    kept = os.dup(_STDOUT)
    os.dup2(writing, _STDOUT)
    os.close(writing)
    threading.Thread(target=_read, args=(reading,), name="native-output", daemon=True).start()
    try:
        yield
    finally:
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
        os.dup2(kept, _STDOUT)
        os.close(kept)


def _read(reading: int) -> None:
    """Log until every writer is gone; with too little memory, go on with the next line."""
    limit, waiting = LineLimit(), b""
    while True:
        with contextlib.suppress(MemoryError):
            data = os.read(reading, _LONGEST)
            if not data:
                os.close(reading)
                return
            *lines, waiting = (waiting + data).split(b"\n")
            if len(waiting) > _LONGEST:
                lines, waiting = [*lines, waiting], b""
            for text in filter(None, (printable(line.decode("utf-8", "replace")) for line in lines)):
                limit.log(partial(LOG.info, "printed: %s%s", text))


@contextlib.contextmanager
def unraisable_to_log(lacks_memory: Callable[[], None]) -> Iterator[None]:
    """Log exceptions that cannot be caught, as in a callback from native code, and count those for want of memory."""
    limit = LineLimit()

    def hook(unraisable: "UnraisableHookArgs") -> None:
        with contextlib.suppress(Exception):
            if issubclass(unraisable.exc_type, MemoryError):
                lacks_memory()
            what = f"{unraisable.exc_type.__name__}: {unraisable.exc_value}" if unraisable.exc_value else "MemoryError"
            where = unraisable.err_msg or "in a callback or destructor"
            limit.log(lambda more: LOG.error("%s, %s%s", printable(what), printable(where), more))

    before, sys.unraisablehook = sys.unraisablehook, hook
    try:
        yield
    finally:
        sys.unraisablehook = before
