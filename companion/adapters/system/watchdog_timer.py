"""Dead man's switch: a timer of the kernel that kills this process unless the control loop renews it.

Why SIGKILL from timer_create and not SIGALRM from setitimer: docs/decisions/0007-dead-man.md.
"""

import ctypes
import logging
import signal

from companion.core.interfaces import CompanionError

LOG = logging.getLogger(__name__)

_CLOCK_MONOTONIC = 1
_SIGEV_SIGNAL = 0
_LIBC = ctypes.PyDLL(None)
"""Its calls keep the interpreter's lock: a renewal takes 2 us, and to get the lock back could take milliseconds."""


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("interval", _Timespec), ("value", _Timespec))


class _Sigevent(ctypes.Structure):
    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("rest", ctypes.c_byte * 48),
    )


class KernelWatchdogTimer:
    """Watchdog timer of the kernel: at `timeout_s` after the last renewal the kernel sends SIGKILL to this process.

    Nothing of the process has to run for that: not Python, not its event loop, not a signal handler, and a process that
    was stopped (SIGSTOP) is killed as well. A child does not inherit it (timer_create(2)).
    """

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._armed = False
        self._timer = ctypes.c_void_p()
        event = _Sigevent(signal=signal.SIGKILL, notify=_SIGEV_SIGNAL)
        if _LIBC.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(self._timer)) != 0:
            raise CompanionError("the kernel gives no watchdog timer: look at ulimit -i (pending signals)")
        whole_s = int(timeout_s)
        self._due = ctypes.byref(_Itimerspec(value=_Timespec(whole_s, round((timeout_s - whole_s) * 1e9))))
        self._never = ctypes.byref(_Itimerspec())

    def renew(self) -> None:
        """Restart the time-out from now (2 us)."""
        if _LIBC.timer_settime(self._timer, 0, self._due, None) != 0:
            raise CompanionError("the watchdog timer cannot be set: is this a fork of the process that made it?")
        if not self._armed:
            self._armed = True
            LOG.info("watchdog timer armed: after %g s without a control cycle it kills us, PX4 lands", self._timeout_s)

    def release(self) -> None:
        """Disable the timer: the process may take its time."""
        if self._armed:
            _LIBC.timer_settime(self._timer, 0, self._never, None)
            self._armed = False
            LOG.info("watchdog timer released")
