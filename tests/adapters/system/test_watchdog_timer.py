"""Tests of the kernel's watchdog timer, each in a process of its own, which it ends."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

pytestmark = pytest.mark.realtime

TIMEOUT_S = 0.2
LATE_S = 5.0
"""A process that lives so long after its watchdog timer was due is not killed by it."""
SET_UP = f"""
import ctypes, os, signal, subprocess, sys, time
from companion.adapters.system.watchdog_timer import KernelWatchdogTimer
watchdog = KernelWatchdogTimer({TIMEOUT_S})
"""


@contextmanager
def process(program: str) -> Iterator[subprocess.Popen[str]]:
    """Start a process with a watchdog timer that runs `program`."""
    command = [sys.executable, "-c", SET_UP + program]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as running:
        try:
            yield running
        finally:
            running.kill()


@pytest.mark.parametrize(
    "hang",
    [
        "time.sleep(60)",
        "ctypes.PyDLL(None).sleep(60)  # keeps the interpreter's lock",
        "while True: pass",
        "os.kill(os.getpid(), signal.SIGSTOP)",
        "signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals()); time.sleep(60)",
    ],
)
def test_a_process_that_hangs_is_killed(hang: str) -> None:
    with process(f"watchdog.renew()\nprint('armed', flush=True)\n{hang}") as hanging:
        assert hanging.stdout is not None
        assert hanging.stdout.readline() == "armed\n"
        begun_s = time.monotonic()
        assert hanging.wait(LATE_S) == -signal.SIGKILL
        assert time.monotonic() - begun_s < LATE_S


def test_who_renews_or_releases_lives_on() -> None:
    program = """
end = time.monotonic() + 1.0
while time.monotonic() < end:
    watchdog.renew()
    time.sleep(0.01)
watchdog.release()
time.sleep(0.5)
watchdog.renew()
watchdog.release()
watchdog.release()
time.sleep(0.5)
"""
    with process(program) as living:
        assert living.wait(30.0) == 0


def test_children_do_not_inherit_it() -> None:
    program = """
watchdog.renew()
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(0.5); print('child lives')"])
forked = os.fork()
if forked == 0:
    time.sleep(0.5)
    try:
        watchdog.renew()
    except Exception as error:
        print("fork:", error, flush=True)
    os._exit(0)
watchdog.release()
child.wait()
os.waitpid(forked, 0)
"""
    with process(program) as parent:
        out, _ = parent.communicate(timeout=30.0)
        assert parent.returncode == 0
        assert "child lives" in out
        assert "fork: the watchdog timer cannot be set" in out
