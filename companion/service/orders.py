"""Requests to the flight for commands that need no further steps."""

import time

from companion.adapters.mqtt.link import Answering
from companion.core.interfaces import FlightError
from companion.flight.flight_loop import FlightLoop
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Reply
from companion.supervisor.flight_state import HoldRequest, KillRequest, LandRequest, Request, ResumeRequest

_REQUESTS: dict[str, Request] = {
    "abort": LandRequest("the operator aborted"),
    "land": LandRequest(),
    "hold": HoldRequest(),
    "resume": ResumeRequest(),
    "kill": KillRequest(),
}


def request_of(command: Command) -> Request | None:
    """Return the request that carries out this command; None for a verb that needs more steps."""
    return _REQUESTS.get(command.verb)


def pass_to_loop(loop: FlightLoop, command: Command, answer: Answering) -> None:
    """Pass a command to the flight loop and reply at once; raise FlightError with the reason when it is refused."""
    request = request_of(command)
    if request is None:
        raise FlightError(f"cannot {command.verb}: only {', '.join(_REQUESTS)} are taken here")
    refusal = loop.refusal(request)
    if refusal or not loop.ask(request):
        raise FlightError(f"cannot {command.verb}: {refusal}")
    for outcome in (Answer.ACCEPTED, Answer.DONE):
        answer(Reply(id=command.id, answer=outcome, time_s=time.time()))
