"""The page's password: its file, and what is no such file."""

import stat
from pathlib import Path

import pytest

from companion.core.errors import ConfigError
from companion.page.passwords import PasswordHash, objection_to
from tests.page.asgi import quick_hash


def test_a_file_knows_its_password_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "page.hash"
    PasswordHash.of("correct horse").write(path)
    read = PasswordHash.read(path)
    assert read.matches("correct horse")
    assert not any(read.matches(other) for other in ("correct hors", "Correct horse", ""))
    assert "correct" not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_file_that_is_there_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "page.hash"
    path.write_text("old")
    path.chmod(0o644)
    quick_hash("another one").write(path)
    assert PasswordHash.read(path).matches("another one")
    assert [one.name for one in tmp_path.iterdir()] == ["page.hash"]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_equal_passwords_have_different_files(tmp_path: Path) -> None:
    assert PasswordHash.of("correct horse").digest != PasswordHash.of("correct horse").digest


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        ("correct horse\n", 0o600, "does not hold the hash"),
        ("", 0o600, "must hold one line"),
        ("scrypt:16384:8:5:" + "A" * 24 + ":" + "B" * 44 + "\n", 0o644, "chmod 600"),
        ("scrypt:16383:8:5:" + "A" * 24 + ":" + "B" * 44 + "\n", 0o600, "does not hold the hash"),
        ("scrypt:4194304:8:5:" + "A" * 24 + ":" + "B" * 44 + "\n", 0o600, "does not hold the hash"),
        ("scrypt:16:8:1:" + "A" * 23 + ":" + "B" * 44 + "\n", 0o600, "does not hold the hash"),
        ("scrypt:16:8:1:" + "A" * 24 + ":" + "B" * 44 + "\nmore\n", 0o600, "must hold one line"),
    ],
)
def test_a_file_that_is_none_is_refused_in_a_sentence(tmp_path: Path, text: str, mode: int, words: str) -> None:
    path = tmp_path / "page.hash"
    path.write_text(text)
    path.chmod(mode)
    with pytest.raises(ConfigError, match=words) as caught:
        PasswordHash.read(path)
    assert str(caught.value).startswith(f"the page's password {path}: ")
    assert "horse" not in str(caught.value), "what is in it is nobody's to read"


def test_a_missing_file_says_how_to_write_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file that could be read: write it with `comp"):
        PasswordHash.read(tmp_path / "none")
    with pytest.raises(ConfigError, match="is no file"):
        PasswordHash.read(tmp_path)


def test_short_and_endless_passwords_are_not_taken() -> None:
    assert objection_to("seven77") == "a password has at least 8 characters"
    assert objection_to("ü" * 129) == "a password has at most 256 bytes"
    assert objection_to("ü" * 128) == ""
