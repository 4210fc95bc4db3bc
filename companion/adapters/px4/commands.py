"""MAVLink's command protocol: a COMMAND_LONG, sent again until its COMMAND_ACK comes.

MAVSDK has one, too (Action, Offboard, MavlinkDirect.send_command_async), but there the callback of a command that is
still unanswered reaches into a plugin that destroy() has freed, up to 2 s later, and the process ends with a
segmentation fault (4.1.0). Here nothing native waits for an answer, so that a link can be closed at any instant; a
command whose caller no longer waits is not sent again.
"""

import asyncio
from enum import IntEnum
from typing import Any

from companion.adapters.px4.mavlink import Px4Mavlink

_RESEND_S = 0.5
"""Period of MAVSDK and QGroundControl."""


class MavResult(IntEnum):
    """MAV_RESULT: what a COMMAND_ACK says."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    LONG_ONLY = 7
    INT_ONLY = 8
    UNSUPPORTED_FRAME = 9
    OTHER = -1
    """A number that MAVLink does not define yet."""

    @classmethod
    def _missing_(cls, value: object) -> "MavResult":  # noqa: ARG003 - whatever it is
        return cls.OTHER


class CommandSender:
    """Sends commands to the autopilot, one of a kind at a time: an acknowledgement names the command's number alone."""

    def __init__(self, mavlink: Px4Mavlink, own_ids: tuple[int, int]) -> None:
        """`own_ids` are our system and component: acknowledgements to others (a ground station) are not ours."""
        self._mavlink, self._own_ids = mavlink, own_ids
        self._loop = asyncio.get_running_loop()
        self._turns: dict[int, asyncio.Lock] = {}
        self._answers: dict[int, asyncio.Queue[MavResult]] = {}
        mavlink.on("COMMAND_ACK", self._on_ack)

    async def send(self, command: int, *params: float | None, timeout_s: float) -> MavResult:
        """Send until the autopilot has answered, and return its answer; TimeoutError when none comes in time.

        `params` are the first of the seven; None is NaN, and those left out are 0. Raises AutopilotError when the link
        does not take the message.
        """
        async with asyncio.timeout(timeout_s), self._turns.setdefault(command, asyncio.Lock()):
            answers = self._answers[command] = asyncio.Queue()
            try:
                return await self._insist(command, params, answers)
            finally:
                del self._answers[command]

    async def _insist(
        self, command: int, params: tuple[float | None, ...], answers: "asyncio.Queue[MavResult]"
    ) -> MavResult:
        confirmation = 0
        while True:
            self._mavlink.send_command(command, *params, confirmation=confirmation)
            try:
                async with asyncio.timeout(_RESEND_S):
                    answer = await answers.get()
                while answer is MavResult.IN_PROGRESS:  # it has arrived: the final answer may take its time
                    answer = await answers.get()
            except TimeoutError:
                confirmation = min(confirmation + 1, 255)
            else:
                return answer

    def _on_ack(self, fields: dict[str, Any]) -> None:
        """Take a COMMAND_ACK on MAVSDK's thread; target 0 is everybody."""
        targets = (fields.get("target_system", 0), fields.get("target_component", 0))
        if all(target in {0, own, None} for target, own in zip(targets, self._own_ids, strict=True)):
            self._loop.call_soon_threadsafe(self._answer, fields["command"], MavResult(fields["result"]))

    def _answer(self, command: int, result: MavResult) -> None:
        if command in self._answers:
            self._answers[command].put_nowait(result)
