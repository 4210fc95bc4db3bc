"""Requests to the flight for commands that need no further steps."""

import time

from companion.adapters.mqtt import Answering
from companion.core.interfaces import FlightError
from companion.flight.flight_loop import FlightLoop
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Reply
from companion.supervisor.flight_state import HoldRequest, KillRequest, LandRequest, Request, ResumeRequest

_WANTED: dict[str, Request] = {
    "abort": LandRequest("the operator aborted"),
    "land": LandRequest(),
    "hold": HoldRequest(),
    "resume": ResumeRequest(),
    "kill": KillRequest(),
}


def wanted_by(command: Command) -> Request | None:
    """Return the request that carries out this command; None for a verb that needs more steps."""
    return _WANTED.get(command.verb)


def obey(loop: FlightLoop, command: Command, answer: Answering) -> None:
    """Pass a command to the flight loop and reply at once; raise FlightError with the reason when it is refused."""
    wanted = wanted_by(command)
    if wanted is None:
        raise FlightError(f"cannot {command.verb}: only {', '.join(_WANTED)} are taken here")
    refusal = loop.refusal(wanted)
    if refusal or not loop.ask(wanted):
        raise FlightError(f"cannot {command.verb}: {refusal}")
    for what in (Answer.ACCEPTED, Answer.DONE):
        answer(Reply(id=command.id, answer=what, time_s=time.time()))
