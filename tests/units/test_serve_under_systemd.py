"""The unit's own command, begun as systemd begins it: a socket for notes, watchdog, journal, and SIGTERM at the end."""

import contextlib
import os
import re
import select
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.units.tools import ROOT, SYSTEMD

pytestmark = pytest.mark.realtime

START_S = 30.0
WATCHDOG_S = 2.0


def free_ports(count: int, kind: socket.SocketKind) -> list[int]:
    sockets = [socket.socket(socket.AF_INET, kind) for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def configuration(folder: Path) -> Path:
    """Write the demo's configuration for a room in which nothing answers."""
    broker, mocap = free_ports(2, socket.SOCK_STREAM)
    (autopilot,) = free_ports(1, socket.SOCK_DGRAM)
    text = (ROOT / "config/demo.toml").read_text().replace("14540", str(autopilot)).replace("22223", str(mocap))
    text += f'\n[operator]\nembedded = true\nport = {broker}\n[records]\nfolder = "{folder}/flights"\nlive_port = 0\n'
    (folder / "companion.toml").write_text(text)
    return folder / "companion.toml"


class Listening:
    """Receiver of the notifications to systemd."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address)
        self.heard: list[str] = []

    def until(self, wanted: str, count: int = 1) -> None:
        """Wait until this many messages have a line that begins so."""
        end_s = time.monotonic() + START_S
        while sum(line.startswith(wanted) for line in self.heard) < count:
            self.socket.settimeout(max(0.01, end_s - time.monotonic()))
            self.heard += self.socket.recv(4096).decode().splitlines()

    def quiet_for(self, time_s: float) -> bool:
        """Return True when nothing more arrives after what was sent before."""
        self.socket.settimeout(0.0)
        with contextlib.suppress(BlockingIOError):
            while True:
                self.socket.recv(4096)
        readable, _, _ = select.select([self.socket], [], [], time_s)
        return not readable


@contextmanager
def started(folder: Path) -> Iterator[tuple[subprocess.Popen[str], Listening]]:
    """ExecStart of the unit, with our own Python and a configuration of the test."""
    unit = (SYSTEMD / "dauam-companion.service").read_text()
    command = re.search(r"^ExecStart=(.+)$", unit, re.MULTILINE)
    assert command is not None
    words = shlex.split(command[1])
    words[0] = str(Path(sys.executable).with_name("companion"))
    words[words.index("/etc/dauam/companion.toml")] = str(configuration(folder))
    listening = Listening(str(folder / "notify"))
    log = folder / "journal"
    with log.open("w") as journal:
        seen = os.fstat(journal.fileno())
        told = {
            "NOTIFY_SOCKET": str(folder / "notify"),
            "WATCHDOG_USEC": str(int(1e6 * WATCHDOG_S)),
            "JOURNAL_STREAM": f"{seen.st_dev}:{seen.st_ino}",
        }
        process = subprocess.Popen(words, cwd=ROOT, stderr=journal, text=True, env={**os.environ, **told})
    try:
        yield process, listening
    finally:
        process.kill()
        process.wait()
        listening.socket.close()


def test_ready_then_alive_then_stopping_and_a_quiet_log(tmp_path: Path) -> None:
    with started(tmp_path) as (process, systemd):
        systemd.until("READY=1")
        systemd.until("WATCHDOG=1", 3)
        process.send_signal(signal.SIGTERM)
        systemd.until("STOPPING=1")
        assert process.wait(START_S) == 0
    lines = (tmp_path / "journal").read_text().splitlines()
    assert all(re.match(r"<[2-7]>\w+: ", line) for line in lines), lines
    assert len(lines) < 10
    assert len(set(lines)) == len(lines)


def test_a_service_that_hangs_gives_no_sign_of_life(tmp_path: Path) -> None:
    with started(tmp_path) as (process, systemd):
        systemd.until("WATCHDOG=1")
        process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
        assert systemd.quiet_for(WATCHDOG_S)
