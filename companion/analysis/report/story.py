"""Events of a flight: phases, faults and failsafe actions, commands and replies, and its end. Pure."""

import math
from dataclasses import dataclass

import numpy as np

from companion.analysis.report.recorded_flight import Flown, Stretch
from companion.supervisor.faults import FailsafeAction
from companion.supervisor.flight_state import IN_THE_AIR, Phase

_SAID = ("command", "reply", "log")
"""Kinds of events that are only in the list of events; phases and faults are columns."""


@dataclass(frozen=True)
class FaultSeen:
    """Fault with its begin and end, s since lift-off; the end is None when it lasted to the end of the record."""

    fault: str
    text: str
    reaction: str
    """Action that was taken, otherwise the one that the reaction table gives for that stage."""
    begin_s: float
    end_s: float | None


@dataclass(frozen=True)
class Reacted:
    """Failsafe action that was taken."""

    at_s: float
    reaction: str
    cause: str
    """Fault; empty when an operator or the autopilot caused it."""
    reason: str


@dataclass(frozen=True)
class Said:
    """Command, reply or log message."""

    at_s: float
    kind: str
    text: str


@dataclass(frozen=True, kw_only=True)
class Story:
    """Events of a flight, each kind in order of time."""

    phases: tuple[Stretch, ...]
    laws: tuple[Stretch, ...]
    faults: tuple[FaultSeen, ...]
    reactions: tuple[Reacted, ...]
    said: tuple[Said, ...]
    ended: str
    """End of the flight in a sentence."""
    over: bool
    """True if the flight ended within the record."""


def story_of(flown: Flown) -> Story:
    """Return the events of a flight."""
    reactions = _reactions(flown)
    faults = _faults(flown, reactions)
    return Story(
        phases=flown.phases,
        laws=flown.laws,
        faults=faults,
        reactions=reactions,
        said=_said(flown),
        ended=_ended(flown),
        over=_is_over(flown),
    )


def _faults(flown: Flown, reactions: tuple[Reacted, ...]) -> tuple[FaultSeen, ...]:
    """Return the faults; a recorded failsafe action takes precedence over the table of failsafe actions."""
    done = {one.cause: one.reaction for one in reactions}
    return tuple(
        FaultSeen(
            one.fault,
            one.text,
            done.get(one.fault, one.reaction),
            one.time_s - flown.zero_s,
            one.end_s - flown.zero_s if math.isfinite(one.end_s) else None,
        )
        for one in flown.record.health
    )


def _reactions(flown: Flown) -> tuple[Reacted, ...]:
    level = np.nan_to_num(flown.column("level"))
    rises = np.flatnonzero(np.diff(level) > 0) + 1
    cause, reason = flown.words("cause"), flown.words("reason")
    return tuple(
        Reacted(
            float(flown.time_s[row]),
            FailsafeAction(int(level[row])).words,
            str(cause[row]),
            _new_words(str(reason[row - 1]), str(reason[row])),
        )
        for row in rises
    )


def _new_words(before: str, after: str) -> str:
    """Return the last of several reasons, which are joined."""
    return after.removeprefix(before).removeprefix("; then ")


def _said(flown: Flown) -> tuple[Said, ...]:
    return tuple(
        Said(event.time_s - flown.zero_s, event.kind, event.text)
        for event in sorted(flown.record.events, key=lambda one: one.time_s)
        if event.kind in _SAID
    )


def _is_over(flown: Flown) -> bool:
    return flown.words("phase")[-1] not in {*IN_THE_AIR, Phase.ARMED} and not flown.column("armed")[-1] > 0.0


def _ended(flown: Flown) -> str:
    phase, reason = str(flown.words("phase")[-1]), str(flown.words("reason")[-1])
    why = f": {reason}" if reason else ""
    if phase == Phase.DISARMED:
        down = "landed and disarmed" if flown.airborne.any() else "disarmed, it never left the ground"
        return down + why
    if phase == Phase.HANDED_OVER:
        armed = "" if flown.column("armed")[-1] > 0.0 else ", which landed and disarmed"
        return f"handed over to the autopilot or its pilot{armed}{why}"
    if phase == Phase.TERMINATED:
        return f"the motors were stopped{why}"
    return f"not known: the record ends in phase {phase}{why}"
