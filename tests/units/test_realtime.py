"""Locked memory and helpers' priorities, each in a process of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

LOCK = """
import logging, resource
logging.basicConfig(level=logging.INFO, format="%(message)s")
{before}
from companion.adapters.system.realtime import lock_memory
locked = lock_memory()
kb = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmLck"))
print(locked, kb > 1000)
"""
HELPER = """
import os, signal, sys
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
except PermissionError:
    pass
from companion.adapters.system.realtime import beside_the_loop
beside_the_loop()
print(os.sched_getscheduler(0) == os.SCHED_OTHER, os.getpriority(os.PRIO_PROCESS, 0) >= 5, flush=True)
for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGABRT):
    os.kill(os.getpid(), number)
sys.stdin.read()
print("closed the file")
"""


def run(program: str) -> tuple[list[str], str]:
    """Run a program; return the lines that it prints and its log."""
    done = subprocess.run([sys.executable, "-c", program], input="", capture_output=True, text=True, check=True)
    return done.stdout.splitlines(), done.stderr


def may_lock() -> bool:
    """Return True when this process may lock memory: by its limit or CAP_IPC_LOCK (bit 14)."""
    lifts = subprocess.run(["sh", "-c", "ulimit -l unlimited"], stderr=subprocess.DEVNULL, check=False).returncode == 0
    effective = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("CapEff"))
    return lifts or bool(int(effective.split()[1], 16) & 1 << 14)


@pytest.mark.skipif(not may_lock(), reason="this user may lock no memory here")
def test_memory_is_locked_where_that_is_allowed() -> None:
    out, log = run(LOCK.format(before=""))
    assert out == ["True True"]
    assert log == "memory is locked\n"


def test_without_the_right_one_line_says_so_and_the_service_goes_on() -> None:
    no_right = """
import os
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
if os.geteuid() == 0:
    os.setgid(65534); os.setuid(65534)
"""
    program = "import companion.adapters.system.realtime\n" + LOCK.format(before=no_right)
    out, log = run(program)
    assert out == ["False False"]
    assert log == "memory is not locked: we may lock 64 kB only (systemd: LimitMEMLOCK=infinity)\n"


def test_a_helper_gives_the_priority_back_and_ends_when_its_pipe_does() -> None:
    out, _ = run(HELPER)
    assert out == ["True True", "closed the file"]
