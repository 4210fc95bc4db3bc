"""Removal of uneventful stretches from a recording, such as a minute of flight without commands and changes."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from tests.mock_autopilot.reenact.events import Event
from tests.mock_autopilot.reenact.session import Cut, Pose, SentFrame, Session, Setpoint, Sticks
from tests.mock_autopilot.reenact.tlog import Decoder, Frame

FOR_A_FILE = (60.0, 8.0, 12.0)
"""Least length of an uneventful stretch (s), and what is kept of it after the last event and before the next."""
FOR_A_TEST = (4.0, 1.0, 1.0)
BOOTED_S = 10.0
"""Nothing is cut before: what a boot brings comes at its own time."""
PERIOD_S = 2.0
"""Period of the slowest message: with whole periods left out all others keep their rhythm."""
APART_S = 0.05
STEADY_S = 0.15
CLIMBS_M, CLIMBS_WITHIN_S = 0.03, 0.2
"""A vehicle that climbs or sinks faster takes off or lands."""
QUESTIONS = {511, 512}
"""Commands whose answers are alike all the time."""

Timed = TypeVar("Timed", SentFrame, Setpoint, Pose, Sticks, Event)


def shortened(session: Session, what: tuple[float, float, float]) -> Session:
    """Cut all uneventful stretches, the last one first; the battery drains through them all the same."""
    worth_s, kept_before_s, kept_after_s = what
    busy = sorted(_busy_s(session))
    times_s = sorted([*(event.at_s for event in session.events), *(one.at_s for one in session.frames)])
    for before_s, after_s in reversed(list(itertools.pairwise(busy))):
        for_s = (after_s - before_s - kept_before_s - kept_after_s) // PERIOD_S * PERIOD_S
        if before_s >= BOOTED_S and after_s - before_s >= worth_s and for_s > 0.0:
            at_s = _between_answers(before_s + kept_before_s, for_s, times_s)
            session = _without(session, Cut(at_s=at_s, for_s=for_s))
    return session


def _between_answers(earliest_s: float, for_s: float, times_s: Sequence[float]) -> float:
    """Return a begin at or after `earliest_s` where neither edge parts a question from its answer."""
    at_s = earliest_s
    while any(abs(edge_s - one) < APART_S for edge_s in (at_s, at_s + for_s) for one in times_s):
        at_s += APART_S
    return round(at_s, 3)


def _busy_s(session: Session) -> list[float]:
    """Return all times at which something happened."""
    events = [event.at_s for event in session.events if not _is_answer(event)]
    frames = [one.at_s for one in session.frames if _matters(one)]
    poses = [*_pauses([one.at_s for one in session.poses]), *_climbs(session.poses)]
    return [*events, *frames, *poses, *_dead(session), session.ends_at_s]


def _dead(session: Session) -> list[float]:
    return [at_s for silence in session.silent_s for at_s in silence]


def _climbs(poses: Sequence[Pose]) -> list[float]:
    """Return the times of a take-off or landing; one pose in twenty shows them."""
    some = poses[::20]
    return [
        after.at_s
        for before, after in itertools.pairwise(some)
        if abs(after.position_m[2] - before.position_m[2]) > CLIMBS_M * (after.at_s - before.at_s) / CLIMBS_WITHIN_S
    ]


def _is_answer(event: Event) -> bool:
    return event.channel == "PARAM_VALUE" or event.what.startswith(("REQUEST_MESSAGE", "SET_MESSAGE_INTERVAL"))


def _matters(frame: SentFrame) -> bool:
    message = Decoder().message(Frame(at_s=frame.at_s, raw=frame.raw))
    if message is None or message.get_type() in {"HEARTBEAT", "PARAM_REQUEST_READ"}:
        return False
    return not (message.get_type() == "COMMAND_LONG" and message.command in QUESTIONS)


def _pauses(times_s: Sequence[float]) -> list[float]:
    return [t for before, after in itertools.pairwise(times_s) if after - before > STEADY_S for t in (before, after)]


def _without(session: Session, cut: Cut) -> Session:
    return replace(
        session,
        ends_at_s=session.ends_at_s - cut.for_s,
        frames=_spliced(session.frames, cut),
        told=_spliced(session.told, cut),
        setpoints=_spliced(session.setpoints, cut),
        poses=_spliced(session.poses, cut),
        sticks=_spliced(session.sticks, cut),
        events=_spliced(session.events, cut),
        cuts=[cut, *(_brought_forward(one, cut) for one in session.cuts)],
    )


def _brought_forward(earlier: Cut, cut: Cut) -> Cut:
    """Move a cut that was made before this one with what follows it."""
    return earlier if earlier.at_s < cut.at_s else replace(earlier, at_s=max(earlier.at_s - cut.for_s, cut.at_s))


def _spliced(items: Sequence[Timed], cut: Cut) -> list[Timed]:
    """Drop what lies in the cut, and bring forward what comes after it."""
    kept = [one for one in items if one.at_s < cut.at_s]
    later = [one for one in items if one.at_s >= cut.at_s + cut.for_s]
    return kept + [replace(one, at_s=one.at_s - cut.for_s) for one in later]
