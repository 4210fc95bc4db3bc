"""A command line typed in this process, and what came of it."""

import resource
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from companion.cli.main import main


@dataclass(frozen=True)
class Typed:
    """Exit code and output of a command line."""

    code: object
    out: str
    err: str


Type = Callable[..., Typed]


def typing(command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    """`companion COMMAND ARGUMENTS`."""
    monkeypatch.setenv("COLUMNS", "200")

    def call(*arguments: str | Path) -> Typed:
        monkeypatch.setattr(sys, "argv", ["companion", command, *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return Typed(ended.value.code, *capsys.readouterr())

    return call


@contextmanager
def disk_full_after(size_bytes: int) -> Iterator[None]:
    """No file of this process grows beyond that; -1: as ever."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes if size_bytes >= 0 else before[0], before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
