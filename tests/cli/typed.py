"""A command line typed in this process, and what came of it."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from companion.cli.main import main


@dataclass(frozen=True)
class Typed:
    """What came of a command line."""

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
