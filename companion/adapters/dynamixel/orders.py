"""What the event loop hands to the worker's thread: goals in a slot, commands in a queue with somebody waiting."""

import asyncio
import queue
from collections.abc import Callable
from dataclasses import dataclass, field

from companion.adapters.dynamixel.torque import Steps
from companion.core.interfaces import ArmError


@dataclass(frozen=True)
class Goals:
    """What the slot holds; a new object is a new order."""

    position_rad: tuple[float, ...] | None = None
    """By joint; None: come to rest."""


@dataclass
class Command:
    """Something to be done between cycles."""

    begin: Callable[[], Steps]
    done: "asyncio.Future[None]"
    abandoned: bool = False
    """Nobody waits any more: do not begin, or stop after the present step."""
    steps: Steps | None = field(default=None, init=False)


class Commands:
    """One after the other, one step a cycle. `submit` is for the event loop, the rest for the worker's thread."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._present: Command | None = None

    def submit(self, begin: Callable[[], Steps]) -> Command:
        """Have something done."""
        command = Command(begin, self._loop.create_future())
        self._waiting.put(command)
        return command

    def step(self) -> None:
        """The next step of the present command; what goes wrong is told to who waits, and raised if unexpected."""
        command = self._present = self._present or self._next()
        if command is None:
            return
        try:
            if _goes_on(command):
                return
            deliver(self._loop, command.done)
        except ArmError as error:
            deliver(self._loop, command.done, error)
        except Exception as error:
            deliver(self._loop, command.done, ArmError(f"the arms' bus failed meanwhile: {error}"))
            self._present = None
            raise
        self._present = None

    def drop_all(self) -> None:
        """Tell all who wait that nothing will come."""
        command = self._present or self._next()
        while command is not None:
            deliver(self._loop, command.done, ArmError("the arms' bus was closed before the command was done"))
            command = self._next()

    def _next(self) -> Command | None:
        try:
            return self._waiting.get_nowait()
        except queue.Empty:
            return None


def _goes_on(command: Command) -> bool:
    if command.steps is None:
        command.steps = command.begin()
    if command.abandoned:
        command.steps.close()
        return False
    return next(command.steps, True) is None


def deliver(loop: asyncio.AbstractEventLoop, future: "asyncio.Future[None]", error: ArmError | None = None) -> None:
    """From the thread into the event loop, if anybody still waits there."""

    def put() -> None:
        if future.done():
            return
        if error is None:
            future.set_result(None)
        else:
            future.set_exception(error)

    if not loop.is_closed():
        loop.call_soon_threadsafe(put)
