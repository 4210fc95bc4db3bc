"""Commands that wait for no other: the request reaches the flight in the same turn of the event loop."""

from collections.abc import Callable, Coroutine
from typing import Any

from companion.core.interfaces import FlightError
from companion.protocol import commands
from companion.service.command_job import CommandJob
from companion.service.flight_actions import FlightActions, ended_by
from companion.supervisor.flight_state import (
    IN_THE_AIR,
    INACTIVE,
    STREAMING,
    HoldRequest,
    KillRequest,
    LandRequest,
    Phase,
    Request,
    ResumeRequest,
)

_STOP_S = 10.0
"""Time allowed to brake, which takes 2 s."""
_REQUESTS: dict[str, Request] = {
    "abort": LandRequest("the operator aborted"),
    "land": LandRequest(),
    "hold": HoldRequest(),
    "resume": ResumeRequest(),
    "kill": KillRequest(),
}


class ImmediateCommands:
    """One command of AT_ONCE: its request is submitted at once, its end is awaited."""

    def __init__(self, service: FlightActions, job: CommandJob, answer_s: float) -> None:
        self._service, self._job, self._answer_s = service, job, answer_s

    def begin(self) -> Coroutine[Any, Any, str]:
        """Submit the request and return the wait for its end; raise FlightError with the reason if it is rejected."""
        command, service = self._job.command, self._service
        if isinstance(command, commands.Disarm):
            return self._begin_disarm()
        inactive = service.phase in INACTIVE
        rejection = service.loop.submit(_REQUESTS[command.verb])
        if inactive and isinstance(command, commands.Land | commands.Abort):
            return self._on_ground(rejection)
        if rejection:
            raise FlightError(rejection)
        self._job.accept()
        if not isinstance(command, commands.Hold | commands.Resume):
            self._cancel_preparation()
        ends: dict[str, Callable[[], Coroutine[Any, Any, str]]] = {
            "abort": self._down,
            "land": self._down,
            "hold": self._hovering,
            "resume": self._resumed,
            "kill": self._motors_off,
        }
        return ends[command.verb]()

    async def _hovering(self) -> str:
        """Wait until the reference stands still."""
        loop = self._service.loop
        end = loop.flight.legs[-1]

        def over() -> bool:
            flight = loop.flight
            return flight.phase is not Phase.HOLD or len(flight.legs) == 1 or flight.legs[-1] is not end

        stands = await self._service.until(over, _STOP_S)
        self._expect_hold()
        if not stands:
            raise FlightError(f"the vehicle still brakes after {_STOP_S:.0f} s")
        if loop.flight.legs[-1] is not end:
            raise FlightError("another command took over while it braked")
        return "it hovers"

    async def _resumed(self) -> str:
        """Wait until the autopilot reports OFFBOARD and the law flies."""
        await self._service.until(lambda: self._service.phase is not Phase.RESUME, self._answer_s)
        self._expect_hold()
        return "we have the vehicle, it hovers"

    async def _motors_off(self) -> str:
        """Wait until the autopilot reports that it is disarmed."""
        service = self._service
        if not await service.until(lambda: not service.status.armed, self._answer_s, although_failed=True):
            raise FlightError(f"the autopilot is still armed: {service.loop.action_failure or 'it does not answer'}")
        return "the motors are off"

    async def _down(self) -> str:
        await self._service.wait_until_down()
        trouble = self._service.trouble
        return f"down and disarmed{f': {trouble}' if trouble else ''}"

    def _on_ground(self, rejection: str) -> Coroutine[Any, Any, str]:
        """End what is being prepared; without any of it, raise FlightError unless the vehicle stands."""
        status = self._service.status
        if rejection and (status.armed or status.in_air):
            raise FlightError(
                "this service does not fly the vehicle, and the autopilot says that it is "
                f"{'in the air' if status.in_air else 'armed'}: use the remote control, or run `companion kill`"
            )
        self._job.accept()
        self._cancel_preparation()
        return _reply_now(f"it stands, {'nothing is under way' if rejection else 'and what was prepared has ended'}")

    def _begin_disarm(self) -> Coroutine[Any, Any, str]:
        service, phase = self._service, self._service.phase
        flying = phase in IN_THE_AIR and not service.loop.flight.touched_down
        if flying or (phase not in STREAMING and service.status.in_air):
            raise FlightError("the vehicle is in the air; run `companion land`, or `companion kill`")
        self._job.accept()
        return self._disarm()

    async def _disarm(self) -> str:
        """Stop the motors on the ground, also of a vehicle that was armed elsewhere."""
        service, reason = self._service, "the operator disarmed"
        self._cancel_preparation(reason)
        if service.phase in {Phase.PREFLIGHT, Phase.ARMED}:
            service.loop.submit(LandRequest(reason))
        elif service.status.armed and service.phase is not Phase.LAND:
            await service.disarm()
        return await self._motors_off()

    def _cancel_preparation(self, reason: str = "") -> None:
        """Stop what no change of phase stops: the checks before arming and, on the ground, a motion of the arms."""
        loop, reason = self._service.loop, reason or f"{self._job.command.verb} was ordered"
        loop.arming.call_off(reason)
        if loop.flight.phase in INACTIVE and loop.arms is not None:
            loop.arms.stop(reason)

    def _expect_hold(self) -> None:
        if self._service.phase is not Phase.HOLD:
            raise FlightError(ended_by(self._service.loop.flight))


async def _reply_now(text: str) -> str:
    """Return a reply that needs no waiting."""
    return text
