"""The end of a process that cannot end in order: without memory, or told to end and not able to. Never in the air."""

import contextlib
import logging
import mmap
import os
import threading
import time
from collections.abc import Callable

LOG = logging.getLogger(__name__)

_LOOK_S = 0.5
_LACKING_S = 5.0
"""A shortage of memory of this duration does not end by itself."""
_FORGOTTEN_S = 2.0
"""Between two failures for want of memory; later ones are another shortage."""
_ENDING_S = 20.0
"""Closing the devices takes a few seconds."""
_WORDS_S = 0.2
_TRIED_BYTES = 1 << 18
"""Size of the interpreter's own allocations."""


class LastResort:
    """Exit of a process that cannot work any more, while the vehicle does not fly; systemd restarts it.

    Its thread runs from the beginning and needs no memory to decide. In the air nothing is done: the dead man's switch
    ends a control loop that stops, and PX4 lands.
    """

    def __init__(self, end: Callable[[int], object] = os._exit, clock_s: Callable[[], float] = time.monotonic) -> None:
        """`end` is called with the exit code."""
        self.flying: Callable[[], bool] = bool
        """Returns True while this service flies the vehicle, or PX4 lands it with its help."""
        self._end, self._clock_s = end, clock_s
        self._told_s: float | None = None
        self._lacking_since_s = self._lacked_s = 0.0
        self._warned = False
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="last-resort", daemon=True)
        self._thread.start()

    def begin_deadline(self) -> None:
        """Start the deadline: on the ground the process has 20 s to end in order."""
        if self._told_s is None:
            self._told_s = self._clock_s()

    def lacks_memory(self) -> None:
        """Record a failure for lack of memory."""
        now_s = self._clock_s()
        if now_s - self._lacked_s > _FORGOTTEN_S:
            self._lacking_since_s = now_s
        self._lacked_s = now_s

    def close(self) -> None:
        """Stop watching: the process has ended in order."""
        self._stopped.set()

    def _why(self, now_s: float) -> str:
        """Return why the process has to end if the vehicle does not fly; empty while it need not."""
        if self._told_s is not None:
            return f"told to end {_ENDING_S:g} s ago, and not able to" if now_s - self._told_s > _ENDING_S else ""
        lacks = now_s - self._lacked_s <= _FORGOTTEN_S and now_s - self._lacking_since_s > _LACKING_S
        return "there is no memory any more" if lacks else ""

    def _watch(self) -> None:
        while not self._stopped.wait(_LOOK_S):
            with contextlib.suppress(Exception):  # the next look may find the memory for it
                if not _memory():
                    self.lacks_memory()
                self.look()

    def look(self) -> None:
        """End the process if it has to, and may."""
        now_s = self._clock_s()
        why, flying = self._why(now_s), self.flying()
        if flying and self._told_s is not None:
            self._told_s = now_s  # it lands first, which takes its time
        elif flying and why and not self._warned:
            self._warned = True
            LOG.critical("%s: land; the process ends when the vehicle is down", why)
        elif why and not flying:
            self._give_up(why)

    def _give_up(self, why: str) -> None:
        with contextlib.suppress(Exception):
            LOG.critical("the process ends at once: %s", why)
            time.sleep(_WORDS_S)  # the log is written by another thread
        self._end(1)


def _memory() -> bool:
    try:
        mmap.mmap(-1, _TRIED_BYTES).close()
    except (OSError, MemoryError):
        return False
    return True
