"""Runs `companion` as a user does: in a process of its own, which has its imports behind it (warm.py)."""

import asyncio
import json
import os
import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests import warm

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 150.0
"""Far beyond what any command here may take; a hang fails its test and does not stop the run."""


@dataclass(frozen=True)
class Ran:
    """Exit code and output of a finished command."""

    code: int
    out: str
    err: str

    @property
    def said(self) -> str:
        """Everything it printed."""
        return self.out + self.err


class Running:
    """A command in flight."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self._lines: list[str] = []
        self._errors: list[str] = []

    async def until_line(self, wanted: str) -> str:
        """Read its output until a line contains `wanted`; return that line."""
        await self._until(self._process.stdout, self._lines, wanted)
        return self._lines[-1]

    async def until_error(self, wanted: str) -> None:
        """Read its standard error until a line contains `wanted`."""
        await self._until(self._process.stderr, self._errors, wanted)

    async def _until(self, stream: asyncio.StreamReader | None, lines: list[str], wanted: str) -> None:
        assert stream is not None
        async with asyncio.timeout(PATIENCE_S):
            while True:
                line = (await stream.readline()).decode()
                lines.append(line)
                if wanted in line:
                    return
                if not line:
                    raise AssertionError(f"it ended without saying {wanted!r}:\n{''.join(lines)}")

    def interrupt(self) -> None:
        """Ctrl-C."""
        self.send(signal.SIGINT)

    def send(self, number: signal.Signals) -> None:
        """Any signal."""
        self._process.send_signal(number)

    async def ended(self) -> Ran:
        """Wait for its end."""
        try:
            async with asyncio.timeout(PATIENCE_S):
                out, err = await self._process.communicate()
        except TimeoutError:
            self._process.kill()
            out, err = await self._process.communicate()
            raise AssertionError(f"it hung; so far:\n{''.join(self._lines)}{out.decode()}{err.decode()}") from None
        assert self._process.returncode is not None
        return Ran(self._process.returncode, "".join(self._lines) + out.decode(), "".join(self._errors) + err.decode())


async def start(*arguments: str | Path) -> Running:
    """Start `companion ARGUMENTS` in the project's root."""
    process = await warm.create_process(
        sys.executable,
        "-m",
        "companion.cli.main",
        *map(str, arguments),
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "200"},
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    return Running(process)


async def run(*arguments: str | Path) -> Ran:
    """Run `companion ARGUMENTS` to its end."""
    return await (await start(*arguments)).ended()


def read_json(path: Path) -> dict[str, Any]:
    """A summary file."""
    data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return data


def mock_config(folder: Path, *changes: tuple[str, str]) -> Path:
    """config/mock.toml with pieces of text replaced; each must be there."""
    text = (ROOT / "config" / "mock.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, f"config/mock.toml has no {old!r} any more"
        text = text.replace(old, new)
    path = folder / "mock.toml"
    path.write_text(text, encoding="utf-8")
    return path


def size_of_only(folder: Path, pattern: str) -> int:
    """Bytes of the one file that matches."""
    [path] = folder.glob(pattern)
    return path.stat().st_size
