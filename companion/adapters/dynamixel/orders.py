"""Goals (one slot, latest wins) and queued commands from the event loop to the bus thread."""

import asyncio
import queue
from collections.abc import Callable
from dataclasses import dataclass, field

from companion.adapters.dynamixel.torque import Steps
from companion.core.interfaces import ArmError


@dataclass(frozen=True)
class Goals:
    """Newest goals in the slot; each new object is a new order."""

    position_rad: tuple[float, ...] | None = None
    """By joint; None: come to rest."""


@dataclass
class Command:
    """Command that runs between bus cycles."""

    begin: Callable[[], Steps]
    done: "asyncio.Future[None]"
    abandoned: bool = False
    """Nobody waits any more: do not begin, or stop after the present step."""
    steps: Steps | None = field(default=None, init=False)


class Commands:
    """Queue of commands, run in order, one step a cycle. `submit` is for the event loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._present: Command | None = None

    def submit(self, begin: Callable[[], Steps]) -> Command:
        """Queue a command and return it; its `done` resolves when it has run."""
        command = Command(begin, self._loop.create_future())
        self._waiting.put(command)
        return command

    def step(self) -> None:
        """Run one step of the current command; errors go to the waiting caller, unexpected ones are raised, too."""
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
        """Fail every queued command with an ArmError."""
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
    """Resolve a future of the event loop from the bus thread, unless it is done or the loop closed."""

    def put() -> None:
        if future.done():
            return
        if error is None:
            future.set_result(None)
        else:
            future.set_exception(error)

    if not loop.is_closed():
        loop.call_soon_threadsafe(put)
