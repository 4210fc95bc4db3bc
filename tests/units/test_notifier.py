"""sd_notify against a real datagram socket, which is all that systemd is for a service."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.adapters.system.systemd import Notifier


@pytest.fixture(params=["path", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """Yield systemd's socket and its address as NOTIFY_SOCKET names it."""
    address = str(tmp_path / "notify") if request.param == "path" else f"@dauam-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(address.replace("@", "\0"))
        listening.settimeout(0.0)
        yield listening, address


def said(listening: socket.socket) -> list[str]:
    """Return all messages received so far."""
    messages = []
    while True:
        try:
            messages.append(listening.recv(4096).decode())
        except BlockingIOError:
            return messages


def test_what_a_service_says_from_its_start_to_its_end(systemd: tuple[socket.socket, str]) -> None:
    listening, address = systemd
    notify = Notifier.from_environment({"NOTIFY_SOCKET": address})
    notify.ready("on the ground")
    notify.status("hold, 1.0 m")
    notify.status("hold, 1.0 m")
    notify.stopping("landing")
    assert said(listening) == ["READY=1\nSTATUS=on the ground", "STATUS=hold, 1.0 m", "STOPPING=1\nSTATUS=landing"]


def test_a_status_is_one_line_and_cannot_say_anything_else(systemd: tuple[socket.socket, str]) -> None:
    listening, address = systemd
    Notifier(address, None).status("a fault:\nREADY=1\n  of two lines")
    assert said(listening) == ["STATUS=a fault: READY=1 of two lines"]


def test_signs_of_life_come_four_times_in_a_period_however_often_the_loop_ticks(
    systemd: tuple[socket.socket, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    listening, address = systemd
    now_s = 100.0
    monkeypatch.setattr("companion.adapters.system.systemd.time.monotonic", lambda: now_s)
    notify = Notifier.from_environment({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "4000000"})
    assert notify.period_s == 4.0
    for _ in range(8 * 128):  # eight seconds
        notify.alive()
        now_s += 1 / 128
    assert said(listening) == ["WATCHDOG=1"] * 8


def test_the_environment_is_not_for_our_children(systemd: tuple[socket.socket, str]) -> None:
    _, address = systemd
    environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "1", "WATCHDOG_PID": "1", "HOME": "/"}
    Notifier.from_environment(environment)
    assert environment == {"HOME": "/"}


@pytest.mark.parametrize(
    "watchdog",
    [{}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "1000000", "WATCHDOG_PID": "1"}],
)
def test_without_a_watchdog_or_with_one_for_another_process_nothing_is_sent(
    systemd: tuple[socket.socket, str], watchdog: dict[str, str]
) -> None:
    listening, address = systemd
    notify = Notifier.from_environment({"NOTIFY_SOCKET": address, **watchdog})
    notify.alive()
    assert notify.period_s is None
    assert said(listening) == []


@pytest.mark.parametrize("address", [None, "", "@", "vsock:2:1234", "relative"])
def test_nobody_is_told_anything_without_an_address_of_systemd(address: str | None) -> None:
    environment = {"WATCHDOG_USEC": "1000000"} | ({} if address is None else {"NOTIFY_SOCKET": address})
    notify = Notifier.from_environment(environment)
    assert notify.period_s is None
    notify.ready("ready")
    notify.alive()
    notify.stopping("over")


def test_a_systemd_that_does_not_read_stops_nothing_and_hears_later_that_we_are_ready(
    systemd: tuple[socket.socket, str],
) -> None:
    listening, address = systemd
    notify = Notifier(address, 1.0)
    count = 0
    while notify._say("STATUS=full"):  # until the socket's buffer is
        count += 1
    notify.ready("ready")
    notify.alive()
    assert said(listening) == ["STATUS=full"] * count
    notify.alive()
    notify.status("hold")
    assert said(listening) == ["READY=1\nWATCHDOG=1", "STATUS=hold"]


def test_systemd_gone_is_no_error(systemd: tuple[socket.socket, str]) -> None:
    listening, address = systemd
    notify = Notifier(address, 1.0)
    listening.close()
    notify.ready("ready")
    notify.alive()


def test_a_real_process_finds_the_socket_in_its_environment(systemd: tuple[socket.socket, str]) -> None:
    listening, address = systemd
    program = "from companion.adapters.system.systemd import Notifier; Notifier.from_environment().ready('here')"
    subprocess.run([sys.executable, "-c", program], check=True, env={**os.environ, "NOTIFY_SOCKET": address})
    assert said(listening) == ["READY=1\nSTATUS=here"]
