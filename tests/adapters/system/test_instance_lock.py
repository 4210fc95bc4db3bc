"""The lock against a second companion, between real processes."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from companion.adapters.system.instance_lock import instance_lock, service_lock
from companion.core.interfaces import AutopilotError, ConfigError

pytestmark = pytest.mark.realtime  # a lock is the whole machine's: not beside the flights
URL = f"udpin://0.0.0.0:{20000 + os.getpid() % 20000}"
HOLD = """
import sys
from companion.adapters.system.instance_lock import instance_lock
with instance_lock(sys.argv[1]):
    print("holding", flush=True)
    sys.stdin.read()
"""


@contextmanager
def another(url: str) -> Iterator[subprocess.Popen[str]]:
    """Start another companion's process that holds the lock."""
    command = [sys.executable, "-c", HOLD, url]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "holding\n"
        yield process
        process.kill()


def test_the_second_is_told_who_the_first_is_until_that_one_is_gone() -> None:
    with another(URL) as first:
        for _ in range(2):
            with pytest.raises(AutopilotError, match=rf"another companion \(process {first.pid}\) already flies {URL}"):
                instance_lock(URL).__enter__()
        first.kill()  # it cannot tidy up
        first.wait()
        with instance_lock(URL):
            pass
        with instance_lock(URL):
            pass


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("udpin://0.0.0.0:34540", "udpin://127.0.0.1:34540"),
        ("udp://:34540", "udpin://0.0.0.0:34540"),
        ("serial:///dev/ttyUSB0:921600", "serial:///dev/../dev/ttyUSB0:57600"),
    ],
)
def test_two_spellings_are_one_link(one: str, other: str) -> None:
    with instance_lock(one), pytest.raises(AutopilotError, match=rf"process {os.getpid()}\)"):
        instance_lock(other).__enter__()


@pytest.mark.parametrize(
    "other",
    ["udpin://0.0.0.0:34541", "udpout://0.0.0.0:34540", "serial:///dev/ttyUSB1:921600", "tcpin://0.0.0.0:34540"],
)
def test_another_link_is_another_vehicle(other: str) -> None:
    with instance_lock("udpin://0.0.0.0:34540"), instance_lock(other):
        pass


def test_a_second_service_is_told_who_the_first_is_and_what_to_do() -> None:
    said = rf"a companion service \(process {os.getpid()}\) runs already on this computer with port 1: stop it first"
    with service_lock("127.0.0.1", 1, ""), service_lock("127.0.0.1", 1, "dauam/one"):
        with pytest.raises(ConfigError, match=said), service_lock("127.0.0.1", 1, ""):
            pass
        with pytest.raises(ConfigError, match="for vehicle 'dauam/one' at the broker"):
            service_lock("127.0.0.1", 1, "dauam/one").__enter__()
    with service_lock("127.0.0.1", 1, ""):
        pass
