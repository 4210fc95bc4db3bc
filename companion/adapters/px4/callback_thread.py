"""MAVSDK's thread for callbacks, made known to the interpreter for good.

ctypes gives a native thread a state of the interpreter for every callback, which takes an mmap and a munmap each
time: a hundred a second in flight, each of which locks what it maps and holds up the page faults of the control loop;
and where no memory is left, not even the handler of errors can run, and the interpreter prints for every message.
"""

import ctypes
import threading

_MOST = 100
"""States are never given back, 16 kB each: a link that comes and goes for days must not eat the memory."""


class CallbackThreads:
    """The native threads of one connection that have called us."""

    _kept = 0

    def __init__(self) -> None:
        self._known: set[int] = set()

    def keep(self) -> None:
        """Keep the calling thread's state of the interpreter, as of the first call on it."""
        ident = threading.get_ident()
        if ident in self._known or CallbackThreads._kept >= _MOST:
            return
        self._known.add(ident)
        CallbackThreads._kept += 1
        ctypes.pythonapi.PyGILState_Ensure()  # without a release
