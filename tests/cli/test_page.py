"""`companion page` and `companion page-password`: what a user may get wrong is answered in one sentence."""

import io
import socket
import stat
import sys
from pathlib import Path
from typing import Any

import pytest

from companion.cli.operator.page import _page
from companion.client.endpoint import EndpointOptions, endpoint_of
from companion.config.locations import default_config_path
from companion.config.operator_config import OperatorConfig, PageConfig
from companion.core.errors import ConfigError
from companion.page.passwords import PasswordHash
from companion.page.server import lines_of
from companion.page.settings import PageSettings
from tests.cli.typed import Type, typing

HASH = "scrypt:16:8:1:" + "A" * 24 + ":" + "B" * 43 + "=\n"


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    return typing("page", monkeypatch, capsys)


@pytest.fixture
def page_password(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    return typing("page-password", monkeypatch, capsys)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("--page-password", "/none"),
            "password /none: there is no such file that could be read: write it with",
        ),
        (("--page-password", "/etc/hosts"), "the page's password /etc/hosts: every user of this computer may read"),
        (("--tls-cert", "x.crt"), "the page's options: tls_cert and tls_key belong together: give both"),
        (("--tls-key", "x.key"), "tls_cert and tls_key belong together"),
        (
            ("--tls-cert", "/none", "--tls-key", "/none"),
            "not in PEM, or not one of the other, or not to be read: No such file",
        ),
        (("--tls-cert", "/etc/hosts", "--tls-key", "/etc/hosts"), "the page's certificate /etc/hosts with its key"),
        (("--host", "192.0.2.1"), "the page on 192.0.2.1, port 8080: cannot be served there (Cannot assign"),
        (("--host", "a b"), "the page on a b, port 8080: not an address of this computer"),
        (("--vehicle", "a b"), "must be 1 to 32 letters, digits, - or _"),
        (("--vehicle", "prefix/"), "--vehicle 'prefix/': give VEHICLE, A,B or PREFIX/A,B"),
        (("--vehicle", ","), "give at least one name"),
        (("--broker", "http://x"), "scheme http is not supported"),
        (("--broker", "mqtts://x", "--ca-file", "/none"), "there is no such file"),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(page: Type, arguments: tuple[str, ...], sentence: str) -> None:
    typed = page(*arguments)
    assert (typed.code, typed.out) == (2, "")
    assert sentence in typed.err
    assert typed.err.startswith("companion: ")
    assert len(typed.err.splitlines()) == 1


def test_a_port_in_use_is_said_in_a_sentence(page: Type) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        typed = page("--port", str(port))
    assert typed.code == 2
    assert f"port {port}: cannot be served there (Address already in use): is there another page?" in typed.err


def lines(port: int, token: str = "", **page: Any) -> list[str]:
    return lines_of(PageSettings(broker=OperatorConfig(), page=PageConfig(**page), token=token), port)


def test_it_says_where_it_is_and_what_it_may() -> None:
    looks = "the page only looks: to command from it, give --page-password FILE"
    assert lines(8080) == ["page: http://127.0.0.1:8080/", looks]
    assert lines(80, password_file="x") == ["page: http://127.0.0.1:80/"]
    assert lines(1, host="::1", tls_cert="x", tls_key="x", password_file="x") == ["page: https://[::1]:1/"]
    assert lines(1, token="abc") == ["page: http://127.0.0.1:1/#token=abc"]
    everywhere = lines(1, host="0.0.0.0", password_file="x")
    assert everywhere[0].endswith("http://127.0.0.1:1/")
    assert "everyone on this network can read the page's password" in everywhere[1]


def test_a_file_has_the_pages_address_and_options_go_first(tmp_path: Path) -> None:
    file = tmp_path / "page.toml"
    file.write_text('[operator]\nhost = "lab"\n[page]\nhost = "0.0.0.0"\nport = 81\npassword_file = "page.hash"\n')
    assert _page({"port": 82, "host": None}, file) == PageConfig(host="0.0.0.0", port=82, password_file="page.hash")
    file.write_text("[page]\nprot = 81\n")
    with pytest.raises(ConfigError, match=r"page\.prot: unknown key, did you mean 'port'"):
        _page({}, file)


def test_the_example_for_the_unit_is_valid() -> None:
    example = default_config_path("page.toml")
    assert endpoint_of(EndpointOptions(config=example)).port == 1883
    assert _page({}, example) == PageConfig(host="0.0.0.0", port=8080)


def test_a_password_is_hashed_into_a_file(page_password: Type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "page.hash"
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\n"))
    typed = page_password(path)
    assert typed.code == 0
    assert typed.err == f"wrote {path}: give it to `companion page --page-password {path}`\n"
    assert PasswordHash.read(path).matches("correct horse")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


@pytest.mark.parametrize("line", ["", "short\n", "x" * 300])
def test_a_password_that_is_none_leaves_the_file(
    page_password: Type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    path = tmp_path / "page.hash"
    path.write_text(HASH)
    monkeypatch.setattr(sys, "stdin", io.StringIO(line))
    typed = page_password(path)
    assert typed.code == 2
    assert "nothing was written" in typed.err
    assert path.read_text() == HASH


def test_two_that_differ_are_not_taken(page_password: Type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = iter(["correct horse", "correct house"])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("companion.cli.operator.page.getpass.getpass", lambda _: next(asked))
    typed = page_password(tmp_path / "page.hash")
    assert (typed.code, "the two differ: nothing was written" in typed.err) == (2, True)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there(page_password: Type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("correct horse\n"))
    typed = page_password(tmp_path / "none" / "page.hash")
    assert (typed.code, typed.err.endswith("page.hash: cannot be written: No such file or directory\n")) == (2, True)
