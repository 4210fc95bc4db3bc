"""Output that an operator sees on a terminal."""

import asyncio
import os
import pty
import signal
import sys

import pytest

from companion.protocol.telemetry import Kind
from tests import warm
from tests.broker import broker
from tests.client.scripted import scripted

_PATIENCE_S = 30.0


class Terminal:
    """A command on a terminal of its own."""

    def __init__(self, port: int, *words: str) -> None:
        self._words = (*words, "--broker", f"mqtt://127.0.0.1:{port}")
        self._said = ""

    async def __aenter__(self) -> "Terminal":
        self._ours, theirs = pty.openpty()
        self.process = await warm.create_process(
            sys.executable, "-m", "companion.cli.main", *self._words, stdin=theirs, stdout=theirs, stderr=theirs,
            env={**os.environ, "COLUMNS": "100", "TERM": "xterm"},
        )  # fmt: skip
        os.close(theirs)
        os.set_blocking(self._ours, False)
        return self

    async def __aexit__(self, *_: object) -> None:
        if self.process.returncode is None:
            self.process.kill()
        await self.process.wait()
        os.close(self._ours)

    async def sees(self, text: str) -> str:
        """All that was shown until `text` was."""
        async with asyncio.timeout(_PATIENCE_S):
            while text not in self._said:
                await asyncio.sleep(0.02)
                try:
                    self._said += os.read(self._ours, 65536).decode()
                except (BlockingIOError, OSError):
                    assert self.process.returncode is None, self._said
        return self._said


async def test_the_live_panel_follows_the_state_and_says_when_nobody_is_there_any_more() -> None:
    with broker() as own:
        async with scripted(own.port, "vehicle") as service, Terminal(own.port, "status") as terminal:
            await terminal.sees("standby")
            service.phase = "hold"
            await terminal.sees("hold")
            service.silent = True
            await service.present(online=False)
            shown = await terminal.sees("the service does not run; last heard")
            terminal.process.send_signal(signal.SIGINT)
            assert await terminal.process.wait() == 130
    assert "Traceback" not in shown


async def test_all_vehicles_are_also_those_that_come_later() -> None:
    with broker() as own:
        async with (
            scripted(own.port, "early"),
            Terminal(own.port, "status", "--vehicle", "all") as panel,
            Terminal(own.port, "status", "--json", "--vehicle", "all") as states,
        ):
            await panel.sees("'early' at")
            await states.sees('"vehicle": "early"')
            async with scripted(own.port, "late") as late, scripted(own.port, "latest"):
                for terminal in (panel, states):
                    await terminal.sees("latest")
                    late.phase = "hold"
                    await terminal.sees("hold")
            panel.process.send_signal(signal.SIGINT)
            assert await panel.process.wait() == 130
            shown = await states.sees('"vehicle": "latest"')
    assert "Traceback" not in shown


async def test_events_are_shown_as_they_happen() -> None:
    with broker() as own:
        async with scripted(own.port, "vehicle") as service, Terminal(own.port, "watch") as terminal:
            await terminal.sees("the service runs")
            await service.tell(Kind.FAULT, "the pose is old", "mocap late")
            await terminal.sees("fault: mocap late: the pose is old")
            await service.tell(Kind.FAULT_ENDS, "the pose is old", "mocap late")
            await terminal.sees("over: mocap late")


@pytest.mark.parametrize(("word", "code"), [("no\n", 2), ("", 130)])
async def test_a_kill_that_is_not_confirmed_is_not_sent(word: str, code: int) -> None:
    async with Terminal(9, "kill") as terminal:
        await terminal.sees("type kill")
        if word:
            os.write(terminal._ours, word.encode())
        else:
            terminal.process.send_signal(signal.SIGINT)
        await terminal.sees("nothing was sent")
        assert await terminal.process.wait() == code
