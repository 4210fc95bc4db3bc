"""`companion page` and `companion page-password`: what a user may get wrong is answered in one sentence."""

import io
import socket
import stat
import sys
from pathlib import Path

import pytest

from companion.config.operator_config import OperatorConfig
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
        (("--page-password", "/none"), "--page-password /none: there is no such file: write it with"),
        (("--page-password", "/etc/hosts"), "--page-password /etc/hosts: every user of this computer may read"),
        (("--tls-cert", "x.crt"), "--tls-cert: give --tls-key as well"),
        (("--tls-key", "x.key"), "--tls-key: give --tls-cert as well"),
        (
            ("--tls-cert", "/none", "--tls-key", "/none"),
            "not a certificate and its key, in PEM, that can be read: No such",
        ),
        (("--tls-cert", "/etc/hosts", "--tls-key", "/etc/hosts"), "not a certificate and its key, in PEM, that can be"),
        (("--host", "192.0.2.1"), "--host 192.0.2.1 --port 8080: the page cannot be served there (Cannot assign"),
        (("--host", "a b"), "--host a b --port 8080: not an address of this computer"),
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
    assert (
        f"--port {port}: the page cannot be served there (Address already in use): is there another page?" in typed.err
    )


def settings(**fields: object) -> PageSettings:
    return PageSettings.model_validate({"broker": OperatorConfig(), **fields})


def test_it_says_where_it_is_and_what_it_may() -> None:
    assert lines_of(settings(), 8080) == [
        "page: http://127.0.0.1:8080/", "the page only looks: to command from it, give --page-password FILE",
    ]  # fmt: skip
    assert lines_of(settings(password_file="x"), 80) == ["page: http://127.0.0.1:80/"]
    assert lines_of(settings(host="::1", tls_cert="x", password_file="x"), 1) == ["page: https://[::1]:1/"]
    assert lines_of(settings(token="abc"), 1) == ["page: http://127.0.0.1:1/#token=abc"]
    everywhere = lines_of(settings(host="0.0.0.0", password_file="x"), 1)
    assert everywhere[0].endswith("http://127.0.0.1:1/")
    assert "everyone on this network can read the page's password" in everywhere[1]


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
