"""`python -m mock_autopilot` as its user meets it."""

import signal
import socket
from pathlib import Path

import pytest

from tests.mock_autopilot.process import free_udp_port, start
from tests.warm import Piped

pytestmark = pytest.mark.realtime


def _ended(process: Piped) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=20.0)
    return process.wait(0.0), out, err


def _ports() -> tuple[str, ...]:
    return ("--port", str(free_udp_port()), "--listen", "0", "--no-qualisys")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--param", "NO_SUCH=1"), "PX4 has no parameter NO_SUCH"),
        (("--param", "COM_OF_LOSS_T"), "--param wants NAME=VALUE"),
        (("--config", "/nowhere/mock.toml"), "cannot read /nowhere/mock.toml"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(arguments: tuple[str, ...], said: str) -> None:
    code, out, err = _ended(start(*arguments))
    assert (code, out) == (2, "")
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_a_wrong_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mock.toml"
    path.write_text("[plant]\nmas_kg = 1.0\n", encoding="utf-8")
    code, _, err = _ended(start("--config", str(path)))
    assert code == 2
    assert "mas_kg" in err


def test_a_port_in_use_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        code, _, err = _ended(start("--listen", str(port), "--no-qualisys"))
    assert code == 2
    assert f"UDP port {port}" in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(number: signal.Signals) -> None:
    process = start(*_ports())
    assert process.stdout.readline().startswith("mock autopilot ready: MAVLink udp ")
    process.send_signal(number)
    assert _ended(process) == (0, "", "")


def test_it_does_not_outlive_its_parent() -> None:
    process = start(*_ports())
    process.stdout.readline()
    process.stdin.close()
    assert process.wait(timeout=10.0) == 0
    process.stdout.close()
    process.stderr.close()
