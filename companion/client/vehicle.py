"""Vehicle that a script commands: each command returns when it is done, and raises when it is not."""

import asyncio
import os
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, aclosing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from companion.client.client import Console
from companion.client.command_draft import CommandDraft
from companion.client.errors import FailedError, RejectedError
from companion.client.messages import Message
from companion.client.ownership import Ownership
from companion.client.paths import Curve, fields_of_path, fields_of_position
from companion.client.pending_command import PendingCommand, Sent
from companion.client.view import VehicleView
from companion.protocol.check import Check, checks_of
from companion.protocol.telemetry import ENDS, Answer, Reply, State

if TYPE_CHECKING:
    from companion.client.paths import Vector, Waypoints

_FRESH_S = 0.5
"""Longest wait for the state that comes after a reply: they are a tenth of a second apart."""


@dataclass(frozen=True)
class Progress:
    """Step of a command under way."""

    verb: str
    text: str
    """Newest sentence of the service on it."""
    elapsed_s: float
    """Time since it was sent."""
    state: State


class Vehicle(VehicleView):
    """One vehicle that a script commands and follows; from `connect`.

    Each command returns the service's sentence when it is done and `state` shows it.

    Raises ConfigError for a value that cannot be, RejectedError, FailedError, NoServiceError, TimedOutError or
    UnknownOutcomeError; after a timeout and when the wait is cancelled the vehicle continues.
    """

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self.progress: Callable[[Progress], None] | None = None
        """Called ten times a second while a command is under way."""
        self.own = Ownership()
        self.on_close: AbstractAsyncContextManager[object] | None = None
        """Connection that `close` ends; None where `async with` ends it."""
        self.arms = Arms(self)
        """Commands for the arms alone."""

    async def preflight(self, *, timeout_s: float | None = None) -> tuple[Check, ...]:
        """Run every check that arming needs and return them; FailedError, with `checks`, when one fails."""
        return checks_of((await self.carry_out(CommandDraft("preflight"), timeout_s)).data)

    async def arm(self, *, timeout_s: float | None = None) -> str:
        """Fold the arms, run all checks, enter offboard mode, idle the motors."""
        return await self._order("arm", timeout_s)

    async def takeoff(self, height_m: float | None = None, *, timeout_s: float | None = None) -> str:
        """Climb to `height_m` above the ground, as configured if None, and hold."""
        return await self._order("takeoff", timeout_s, height_m=height_m)

    async def goto(
        self, position_w_m: "Vector", yaw_rad: float | None = None, *, timeout_s: float | None = None
    ) -> str:
        """Fly to a position in W, (3,), m, and to a heading, unchanged if None; then hold."""
        return await self._order("goto", timeout_s, yaw_rad=yaw_rad, **fields_of_position(position_w_m))

    async def track(
        self,
        path: "Curve | str | os.PathLike[str] | Waypoints",
        *,
        arms: str | None = None,
        timeout_s: float | None = None,
    ) -> str:
        """Fly to the start of a path, fly it, and hold at its end.

        `path`: a `Curve`, "ellipse", "figure8", a CSV file, or an array (N, 4) or (N, 5) of t_s, x_m, y_m, z_m in W and
        perhaps yaw_rad. `arms`: motion of the service's config/arms/ that begins with the path.
        """
        return await self._order("track", timeout_s, arms=arms, **fields_of_path(path))

    async def controller(self, name: str, *, timeout_s: float | None = None) -> str:
        """Switch to another control law of the service's config/controllers/, also in the air."""
        return await self._order("controller", timeout_s, name=name)

    async def hold(self, *, timeout_s: float | None = None) -> str:
        """Brake and hover; this ends a command under way."""
        return await self._order("hold", timeout_s)

    async def land(self, *, timeout_s: float | None = None) -> str:
        """Fold the arms, land at the current position, disarm."""
        return await self._order("land", timeout_s)

    async def abort(self, *, timeout_s: float | None = None) -> str:
        """Land, and note the abort in the record; on the ground stop the motors."""
        return await self._order("abort", timeout_s)

    async def resume(self, *, timeout_s: float | None = None) -> str:
        """Take control back from the autopilot or its pilot, and hover."""
        return await self._order("resume", timeout_s)

    async def disarm(self, *, timeout_s: float | None = None) -> str:
        """Stop the motors; only on the ground."""
        return await self._order("disarm", timeout_s)

    async def kill(self, confirm: Literal["kill"], *, timeout_s: float | None = None) -> str:
        """Stop the motors at once: in the air the vehicle FALLS."""
        return await self._order("kill", timeout_s, confirm=confirm)

    async def params(self, *, timeout_s: float | None = None) -> dict[str, Any]:
        """Return configuration, gains and the autopilot's parameters in use."""
        return (await self.carry_out(CommandDraft("params"), timeout_s)).data

    async def close(self) -> None:
        """End the connection of `await connect()`; nothing is commanded."""
        if self.on_close is not None:
            await self.on_close.__aexit__(None, None, None)
            self.on_close = None

    async def execute(
        self,
        draft: CommandDraft,
        *,
        timeout_s: float | None = None,
        wait: bool = True,
        hear: Callable[[Message], None] | None = None,
    ) -> Reply:
        """Send any command and return its last reply; without `wait` return once the service has accepted it.

        `hear` gets every message meanwhile.
        """
        pending = PendingCommand(self.console, draft, self.timeout_s if timeout_s is None else timeout_s)
        report, last = self._reporter(draft), ENDS if wait else ENDS | {Answer.ACCEPTED}
        self.own.begins(draft)
        try:
            async with aclosing(pending.messages()) as messages:
                async for message in messages:
                    for tell in (report, hear):
                        if tell is not None:
                            tell(message)
                    if isinstance(message, Reply) and message.id == draft.id and message.answer in last:
                        return _good(draft.verb, message)
        finally:
            if pending.sent is Sent.NO:
                self.own.is_not_sent(draft)
        raise AssertionError("messages end with a reply")

    async def carry_out(self, draft: CommandDraft, timeout_s: float | None) -> Reply:
        """Send any command; return its last reply once `state` is of the time after it."""
        with self.console.inbox() as inbox:
            reply = await self.execute(draft, timeout_s=timeout_s)
            end_s = asyncio.get_running_loop().time() + _FRESH_S
            while self.state.time_s < reply.time_s and asyncio.get_running_loop().time() < end_s:
                await inbox.next(_FRESH_S)
        return reply

    async def _order(self, verb: str, timeout_s: float | None, **fields: object) -> str:
        return (await self.carry_out(CommandDraft(verb, **fields), timeout_s)).text

    def _reporter(self, draft: CommandDraft) -> Callable[[Message], None] | None:
        """Return what passes the messages of a command to the script's `progress`; None without one."""
        progress, clock, text = self.progress, asyncio.get_running_loop(), ""
        if progress is None:
            return None
        begun_s = clock.time()

        def report(message: Message) -> None:
            nonlocal text
            if isinstance(message, Reply) and message.id == draft.id:
                text = message.text or text
            elif isinstance(message, State):
                progress(Progress(draft.verb, text, clock.time() - begun_s, message))

        return report


class Arms:
    """Commands for the arms of one vehicle; from `Vehicle.arms`."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    async def ready(self, *, timeout_s: float | None = None) -> str:
        """Switch torque on, then fold the arms; on the ground only."""
        return await self._do("ready", timeout_s)

    async def stow(self, *, timeout_s: float | None = None) -> str:
        """Fold both arms as for take-off and landing."""
        return await self._do("stow", timeout_s)

    async def play(self, motion: str, *, timeout_s: float | None = None) -> str:
        """Play a motion of the service's config/arms/, in hold too."""
        return await self._do("play", timeout_s, motion)

    async def hold(self, *, timeout_s: float | None = None) -> str:
        """Stop the arms and hold them there, torque on."""
        return await self._do("hold", timeout_s)

    async def limp(self, *, timeout_s: float | None = None) -> str:
        """Switch torque off, on the ground only: the arms FALL."""
        return await self._do("limp", timeout_s)

    async def clear(self, *, timeout_s: float | None = None) -> str:
        """Forget the servos' faults; `ready` is needed before they move again."""
        return await self._do("clear", timeout_s)

    async def _do(self, do: str, timeout_s: float | None, motion: str | None = None) -> str:
        draft = CommandDraft("arms", do=do, motion=motion)
        return (await self._vehicle.carry_out(draft, timeout_s)).text


def _good(verb: str, reply: Reply) -> Reply:
    if reply.answer is Answer.REFUSED:
        raise RejectedError(verb, reply)
    if reply.answer is Answer.FAILED:
        raise FailedError(verb, reply)
    return reply
