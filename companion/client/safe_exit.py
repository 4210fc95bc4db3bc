"""End of a script by an error: its flight is landed, and what it has under way elsewhere is ended."""

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Literal

from companion.client.command_draft import CommandDraft
from companion.client.errors import FailedError, NoServiceError, RejectedError, UnknownOutcomeError
from companion.client.messages import Message
from companion.client.ownership import Fields
from companion.client.pending_command import known_of
from companion.client.vehicle import Vehicle
from companion.core.errors import CompanionError
from companion.protocol.telemetry import State

LOG = logging.getLogger("companion.client")
LandOnError = bool | Literal["any"]
"""True: land a flight that this script began; "any": land every vehicle that flies; False: command nothing."""
_REMEDY_S = 15.0
"""Time limit of a command that ends another one; a hold takes a few seconds to stop."""
_REACH_S = 60.0
"""Time to go on trying while broker or service are not reached."""
_DOWN_S = 120.0
_AGAIN_S = 0.2
_LANDING = frozenset({"stow", "land"})
_HANDED_OVER = "handed over"


async def make_safe(vehicle: Vehicle, error: BaseException, land: LandOnError) -> None:
    """Land or hold because of the error that ends a script; what came of it becomes a note of `error`.

    A second error while landing becomes a note, too. A cancellation, as by Ctrl-C, ends the wait, not the landing.
    """
    cause = "an interruption" if isinstance(error, asyncio.CancelledError | KeyboardInterrupt) else repr(error)
    try:
        outcome = await _end_flight(vehicle, land, cause)
    except CompanionError as second:
        outcome = f"NOT known to be safe: {second}"
    except (asyncio.CancelledError, KeyboardInterrupt):  # the latter where Ctrl-C meets this very step of asyncio's
        if cause == repr(error):
            LOG.error("the script's own error:", exc_info=error)  # noqa: TRY400 - asyncio.run shows the second Ctrl-C alone
        LOG.warning("%s: interrupted again: not waiting; %s", vehicle.name, known_of(vehicle.console))
        raise
    if outcome:
        LOG.warning("%s: %s", vehicle.name, outcome)
        error.add_note(f"{vehicle.name}: {outcome}")


def warn_of_flight(vehicle: Vehicle) -> None:
    """Log that a script ends and leaves its vehicle armed."""
    if vehicle.own.owns_flight and vehicle.state.armed:
        LOG.warning("%s: the script ends, the vehicle does not: %s", vehicle.name, known_of(vehicle.console))


async def _end_flight(vehicle: Vehicle, land: LandOnError, cause: str) -> str:
    """Return what was done; empty when there was nothing to do."""
    own = vehicle.own
    if not land or not (land == "any" or own.owns_flight or own.any_under_way):
        return ""
    end_s = asyncio.get_running_loop().time() + _REACH_S
    state = await _reached(vehicle, end_s)
    if state.phase == _HANDED_OVER:
        return "nothing was commanded: the autopilot or its pilot has the vehicle"
    if own.owns_flight or (land == "any" and (state.armed or state.in_air)):
        LOG.warning("%s: landing because of %s; Ctrl-C ends the wait, not the landing", vehicle.name, cause)
        return f"landed because of {cause}: {await _land(vehicle, state, end_s)}"
    remedies = own.remedies(state)
    return f"because of {cause}: {await first_accepted(vehicle, remedies)}" if remedies else ""


async def _land(vehicle: Vehicle, state: State, end_s: float) -> str:
    """Land and return how; try again while broker or service are not reached."""
    while True:
        try:
            if state.phase in _LANDING:
                await vehicle.wait_until(lambda state: not state.armed, timeout_s=_DOWN_S)
                return "down and disarmed"
            return (await vehicle.execute(CommandDraft("abort"), timeout_s=_DOWN_S)).text
        except (NoServiceError, UnknownOutcomeError) as error:
            if asyncio.get_running_loop().time() > end_s:
                raise
            LOG.warning("%s: %s; trying again", vehicle.name, error)
        state = await _reached(vehicle, end_s)


async def _reached(vehicle: Vehicle, end_s: float) -> State:
    """Return a fresh state; NoServiceError when there is none until `end_s`."""
    while True:
        try:
            return await vehicle.console.find()
        except NoServiceError:
            if asyncio.get_running_loop().time() > end_s:
                raise
        await asyncio.sleep(_AGAIN_S)


async def first_accepted(
    vehicle: Vehicle,
    remedies: Sequence[Fields],
    begin: Callable[[str], None] = lambda _: None,
    hear: Callable[[Message], None] | None = None,
) -> str:
    """Send commands until one is not rejected; return the sentence about its end.

    `begin` gets each one's words, `hear` every message meanwhile. Raises NoServiceError or UnknownOutcomeError when its
    end is not known.
    """
    outcome = ""
    for remedy in remedies:
        what = " ".join(str(value) for value in remedy.values())
        begin(what)
        try:
            return (await vehicle.execute(CommandDraft(**remedy), timeout_s=_REMEDY_S, hear=hear)).sentence(what)
        except FailedError as error:
            return str(error)
        except RejectedError as error:
            outcome = str(error)
    return outcome
