"""Requests of the flight loop to the autopilot, apart from setpoints, without waiting for the answer."""

import asyncio
import logging
from collections.abc import Awaitable, Callable

from companion.core.interfaces import Autopilot, CompanionError
from companion.supervisor.flight_state import Action

LOG = logging.getLogger(__name__)


class AutopilotCalls:
    """Begins calls and keeps hold of them; one that fails is logged, and its sentence kept for the operator."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._how: dict[Action, Callable[[], Awaitable[None]]] = {
            Action.DISARM: autopilot.disarm,
            Action.AUTOPILOT_LAND: autopilot.land,
            Action.OFFBOARD: autopilot.start_offboard,
            Action.KILL: autopilot.kill,
        }
        self._tasks: dict[asyncio.Task[None], Action] = {}
        self.failure = ""
        """Why the autopilot did not do the last thing it did not do; empty if it did all."""

    @property
    def pending(self) -> bool:
        """Return True if an answer is still awaited."""
        return bool(self._tasks)

    def forget(self) -> None:
        """Forget why something was not done: another flight begins, and it is no reason of that one."""
        self.failure = ""

    def begin(self, action: Action) -> None:
        """Ask; returns at once.

        A kill goes first: what still waits is given up for it, and nothing is asked beside it, as it insists by itself.
        Anything else takes the place of the same call that still waits: on a dead link calls must not pile up.
        """
        if Action.KILL in self._tasks.values():
            return
        for task, asked in self._tasks.items():
            if action is Action.KILL:
                task.cancel()
            elif asked is action and task.cancel():
                self.failure = f"the autopilot has not done it yet and is asked once more: {action}"
        task = asyncio.get_running_loop().create_task(self._attempt(action), name=f"companion.{action}")
        self._tasks[task] = action
        task.add_done_callback(self._tasks.pop)

    async def _attempt(self, action: Action) -> None:
        try:
            await self._how[action]()
        except CompanionError as error:
            self.failure = str(error)
            LOG.error("%s", error)  # noqa: TRY400 - the sentence is for the operator, the trace would hide it
        except Exception as error:
            self.failure = f"{type(error).__name__}: {error}"
            LOG.exception("what the loop asked of the autopilot failed")

    async def cancel(self) -> None:
        """Wait for nothing more, except for motors that were to stop: one message may be lost."""
        tasks = dict(self._tasks)
        for task, action in tasks.items():
            if action is not Action.KILL:
                task.cancel()
        if tasks:
            await asyncio.wait(tasks)  # gather would cancel them all when it is cancelled itself
