"""One command under way and the replies to its sender."""

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from companion.protocol import commands
from companion.protocol.check import Check
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Reply

SendReply = Callable[[Reply], None]
"""Receiver of the replies to one command; must neither block nor raise."""
CHANNELS = ("flight", "arms")


class CommandJob:
    """A command under way: its replies, its task, and whether it was cancelled."""

    def __init__(self, command: Command, send_reply: SendReply) -> None:
        self.command, self._send_reply = command, send_reply
        self.accepted = False
        self.text = ""
        self.preparing = True
        """True until the flight or the arms have started it; from then on a new request ends it by itself."""
        self.called_off = ""
        """Reason why it was cancelled; empty while it may go on."""
        self._task: asyncio.Task[Any] | None = None

    def begin(self) -> None:
        """Remember the current task as the one that carries out this command."""
        self._task = asyncio.current_task()

    def call_off(self, why: str) -> None:
        """Cancel it, also when its task has not run yet; the first reason is kept."""
        self.called_off = self.called_off or why
        if self._task is not None:
            self._task.cancel()

    def accept(self, text: str = "") -> None:
        """Report that it is accepted, once; afterwards it can fail but is not refused any more."""
        if not self.accepted:
            self.accepted = True
            self.answer(Answer.ACCEPTED, text)

    def progress(self, text: str, checks: Sequence[Check] = ()) -> None:
        """Report the step that it has reached, with the preflight checks whose result is known by now."""
        self.text = text
        self.answer(Answer.PROGRESS, text, {"checks": [asdict(check) for check in checks]} if checks else None)

    def answer(self, answer: Answer, text: str = "", data: dict[str, Any] | None = None) -> None:
        """Send a reply to the sender of the command."""
        self._send_reply(Reply(id=self.command.id, answer=answer, time_s=time.time(), text=text, data=data or {}))


def channels_of(command: Command) -> tuple[str, ...]:
    """Return the channels a command occupies; commands of one channel exclude each other.

    `arm`, and `track` with a motion of the arms, occupy both: nothing else moves the arms meanwhile.
    """
    if isinstance(command, commands.Arms):
        return () if command.do == "hold" else ("arms",)
    if isinstance(command, commands.Params):
        return ()
    both = isinstance(command, commands.Arm) or (isinstance(command, commands.Track) and command.arms is not None)
    return CHANNELS if both else ("flight",)
