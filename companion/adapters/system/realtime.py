"""Real-time settings that keep other programs, page faults and helper threads from delaying the control loop."""

import ctypes
import gc
import logging
import os
import resource
import signal
from pathlib import Path

LOG = logging.getLogger(__name__)

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_CAP_IPC_LOCK = 14
_HELPER_NICE = 5
_OF_THE_SERVICE = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGABRT)
SWITCH_INTERVAL_S = 0.0005
"""Interval after which a computing thread yields to the control loop; Python's default is 5 ms."""


def spare_the_collector() -> None:
    """Exempt everything built so far from garbage collection, which would take 50 ms in flight."""
    gc.collect()
    gc.freeze()


def lock_memory() -> bool:
    """Keep all memory of this process, also what it will get, out of swap; says in one line whether it could.

    Only without a limit (systemd: LimitMEMLOCK=infinity): below one, memory that is asked for later, in flight, would
    be refused (mlockall(2)). Neither a fork nor an executed program inherits it.
    """
    if not _without_limit():
        limit_kb = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1] // 1024
        LOG.warning("memory is not locked: we may lock %d kB only (systemd: LimitMEMLOCK=infinity)", limit_kb)
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        LOG.warning("memory is not locked: %s", os.strerror(ctypes.get_errno()))
        return False
    LOG.info("memory is locked")
    return True


def _without_limit() -> bool:
    """Lift the limit of locked memory; True when that works, or the capability makes it needless."""
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines())
    if int(status["CapEff"], 16) >> _CAP_IPC_LOCK & 1:
        return True
    try:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    except (ValueError, OSError):
        return False
    return True


def beside_the_loop() -> None:
    """Call first in a process that helps the service (recorder, broker): the control loop goes first, and ends first.

    The helper inherits the service's real-time priority and gives it back. systemd sends its signals to every process
    of the service at once; the helper has work left until the service is through, so it minds none of them: it has to
    end when its pipe from the service does, or by SIGKILL.
    """
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.setpriority(os.PRIO_PROCESS, 0, max(_HELPER_NICE, os.getpriority(os.PRIO_PROCESS, 0)))
    for number in _OF_THE_SERVICE:
        signal.signal(number, signal.SIG_IGN)
