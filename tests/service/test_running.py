"""`make test` itself: what it says of programs that this machine does not have, and its exit code."""

import subprocess
import sys

import pytest

from tests.packages import HIDE, PACKAGES, find_program, missing_packages


def run(*arguments: str) -> tuple[int, list[str]]:
    """Return exit code and lines of `python -m tests`."""
    command = [sys.executable, "-m", "tests", *arguments, "-n", "0"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout.splitlines()


@pytest.mark.slow
def test_the_last_lines_count_what_was_skipped_for_want_of_which_package() -> None:
    code, lines = run("--without-packages", "tests/units/test_unit_files.py", "-k", "udev or scripts or rule_makes")
    assert code == 0
    assert "skipped: 1 for want of udev" in lines
    assert "to run them, too: sudo apt-get install udev   (Debian, Ubuntu)" in lines
    assert lines[-1] == "1 passed, 0 failed, 1 skipped"


@pytest.mark.slow
def test_nothing_selected_is_no_success() -> None:
    assert run("--without-packages", "tests/units/test_unit_files.py", "-k", "no_such_test")[0] == 5


def test_every_program_is_missing_where_they_are_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(HIDE, raising=False)
    assert find_program("sh") is not None
    monkeypatch.setenv(HIDE, "1")
    assert find_program("sh") is None
    assert missing_packages(tuple(PACKAGES)) == sorted(set(PACKAGES.values()))
