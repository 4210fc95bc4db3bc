"""One command that is being carried out, and whoever waits for it."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

from companion.protocol import commands as asked
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Reply

Say = Callable[[Reply], None]
"""Where the answers to one command go; must neither wait nor raise."""
LANES = ("flight", "arms")


class CommandJob:
    """One command that is being carried out, and whoever waits for it."""

    def __init__(self, command: Command, say: Say) -> None:
        self.command, self._say = command, say
        self.accepted = False
        self.text = ""
        self.preparing = True
        """Nothing of it has begun that an order to the flight, or to the arms, would end by itself."""
        self.called_off = ""
        """Why nothing may follow from it any more; empty when something may."""
        self._task: asyncio.Task[Any] | None = None

    def begin(self) -> None:
        """The task that runs now carries it out."""
        self._task = asyncio.current_task()

    def call_off(self, why: str) -> None:
        """Have nothing follow from it, also when its task has not run yet."""
        self.called_off = self.called_off or why
        if self._task is not None:
            self._task.cancel()

    def accept(self, text: str = "") -> None:
        """It fits: from here on it can fail, but is not refused any more."""
        if not self.accepted:
            self.accepted = True
            self.answer(Answer.ACCEPTED, text)

    def progress(self, text: str) -> None:
        """Tell where it is."""
        self.text = text
        self.answer(Answer.PROGRESS, text)

    def answer(self, answer: Answer, text: str = "", data: dict[str, Any] | None = None) -> None:
        """Say it to whoever asked."""
        self._say(Reply(id=self.command.id, answer=answer, time_s=time.time(), text=text, data=data or {}))


def channels_of(command: Command) -> tuple[str, ...]:
    """Commands of one lane exclude each other. While it is armed, or flies with them, nobody else moves the arms."""
    if isinstance(command, asked.Arms):
        return () if command.do == "hold" else ("arms",)
    if isinstance(command, asked.Params):
        return ()
    both = isinstance(command, asked.Arm) or (isinstance(command, asked.Track) and command.arms is not None)
    return LANES if both else ("flight",)
