"""The embedded broker: it is there again whatever ends it, and says why it is not."""

import asyncio
import logging
import os
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.adapters.broker import process
from companion.adapters.broker.process import open_broker
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import ConfigError
from tests.ports import free_port

pytestmark = pytest.mark.slow

PATIENCE_S = 40.0


def answers(port: int) -> bool:
    """Return True when the port accepts a TCP connection."""
    try:
        socket.create_connection(("127.0.0.1", port)).close()
    except OSError:
        return False
    return True


def child() -> int:
    """Return the process of the embedded broker."""
    children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    (found,) = [int(one) for one in children if b"adapters.broker" in Path(f"/proc/{one}/cmdline").read_bytes()]
    return found


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not true():  # noqa: ASYNC110 - it is in another process
            await asyncio.sleep(0.02)


async def test_it_comes_back_and_says_who_has_its_port_meanwhile(
    caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.INFO, "companion.adapters.broker")
    config = OperatorConfig(port=free_port(), embedded=True)
    async with open_broker(config):
        assert answers(config.port)
        with pytest.raises(ConfigError, match="is there one already"):
            async with open_broker(config):
                pass
        os.kill(child(), signal.SIGKILL)
        await until(lambda: "is started again" in caplog.text)
        with socket.create_server(("127.0.0.1", config.port)):
            await until(lambda: f"the embedded broker on port {config.port} does not begin: " in caplog.text)
        await until(lambda: "is there again" in caplog.text)
        assert answers(config.port)
        assert caplog.text.count("does not begin") == 1
        assert "without a word" not in caplog.text
    assert not answers(config.port)
    assert capfd.readouterr() == ("", ""), "the log says all there is to say"


async def test_one_that_hangs_is_killed_and_started_again(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "_HUNG_S", 1.5)
    config = OperatorConfig(port=free_port(), embedded=True)
    async with open_broker(config):
        hung = child()
        os.kill(hung, signal.SIGSTOP)
        await until(lambda: "has said nothing for 1.5 s and is started again" in caplog.text)
        await until(lambda: answers(config.port))
        assert child() != hung
