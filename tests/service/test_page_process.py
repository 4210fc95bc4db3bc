"""The live page's process beside the service: it ends with it, and its troubles are lines."""

import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from queue import SimpleQueue

import pytest

from companion.config.operator_config import OperatorConfig, PageConfig
from companion.page.settings import PageSettings
from companion.service import page_process as module
from companion.service.page_process import PageOptions, page_process
from tests.ports import free_port

PATIENCE_S = 20.0


def test_its_settings_are_what_the_page_reads() -> None:
    page = PageConfig(port=0, password_file="page.hash")
    broker = OperatorConfig(embedded=True, port=1884)
    read = PageSettings.model_validate_json(PageOptions(broker, page, "secret", ("a", "b")).line())
    assert (read.broker, read.page, read.token, read.vehicles) == (broker, page, "secret", ("a", "b"))


def begins(script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a script in place of the page."""
    popen: Callable[..., subprocess.Popen[bytes]] = subprocess.Popen

    def other(_: object, **streams: object) -> "subprocess.Popen[bytes]":
        return popen([sys.executable, "-c", script], **streams)

    monkeypatch.setattr("companion.service.page_process.subprocess.Popen", other)


@pytest.mark.parametrize(
    ("script", "line"),
    [
        ("print('error: port 1: in use'); raise SystemExit(2)", "the page is not served: port 1: in use"),
        ("raise SystemExit(7)", "the page has ended by itself (7): `companion page` starts another one"),
    ],
)
def test_whatever_becomes_of_it_is_a_line(monkeypatch: pytest.MonkeyPatch, script: str, line: str) -> None:
    begins(script, monkeypatch)
    heard: SimpleQueue[str] = SimpleQueue()
    with page_process(PageOptions(OperatorConfig(), PageConfig()), heard.put):
        assert heard.get(timeout=PATIENCE_S) == line
    assert heard.empty()


def test_one_that_cannot_be_begun_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(12, "Cannot allocate memory")

    monkeypatch.setattr("companion.service.page_process.subprocess.Popen", refuse)
    heard: list[str] = []
    with page_process(PageOptions(OperatorConfig(), PageConfig()), heard.append):
        assert heard == ["the page is not served: Cannot allocate memory"]


def test_one_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    begins("import time; print('page: http://x/', flush=True); time.sleep(60)", monkeypatch)
    monkeypatch.setattr(module, "_END_S", 0.1)
    heard: SimpleQueue[str] = SimpleQueue()
    with page_process(PageOptions(OperatorConfig(), PageConfig()), heard.put):
        assert heard.get(timeout=PATIENCE_S) == "page: http://x/"
    assert heard.empty()


@pytest.mark.realtime
def test_the_real_one_serves_and_ends_with_it() -> None:
    heard: SimpleQueue[str] = SimpleQueue()
    with page_process(PageOptions(OperatorConfig(port=free_port()), PageConfig(port=0)), heard.put):
        line = heard.get(timeout=PATIENCE_S)
        assert line.startswith("page: http://127.0.0.1:")
        assert "only looks" in heard.get(timeout=PATIENCE_S)
        url = line.removeprefix("page: ")
        with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
            assert answer.status == 200
    port = int(url.rstrip("/").rpartition(":")[2])
    with socket.socket() as free:
        assert free.connect_ex(("127.0.0.1", port)) != 0
    assert heard.empty()
