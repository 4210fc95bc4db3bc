"""Removal of uneventful stretches from a recording, such as a minute of flight without commands and changes."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from tests.mock_autopilot.reenact.events import Event
from tests.mock_autopilot.reenact.session import Cut, Pose, SentFrame, Session, Setpoint, Sticks
from tests.mock_autopilot.reenact.tlog import Decoder, Frame

WORTH_S = 60.0
BEFORE_S, AFTER_S = 8.0, 12.0
"""Kept after the last event before the cut, and before the first one after it."""
PERIOD_S = 2.0
"""Period of the slowest message: with whole periods left out all others keep their rhythm."""
STEADY_S = 0.15
QUIET_CHANNELS = {"battery"}
QUESTIONS = {511, 512}
"""Commands whose answers are alike all the time."""

Timed = TypeVar("Timed", SentFrame, Setpoint, Pose, Sticks, Event)


def shortened(session: Session) -> Session:
    """Cut the longest uneventful stretch, if it is worth while; the battery drains through it all the same."""
    busy = sorted(_busy_s(session))
    gap_s, start_s = max((after - before, before) for before, after in itertools.pairwise(busy))
    if gap_s < WORTH_S:
        return session
    for_s = (gap_s - BEFORE_S - AFTER_S) // PERIOD_S * PERIOD_S
    return _without(session, Cut(at_s=start_s + BEFORE_S, for_s=for_s))


def _busy_s(session: Session) -> list[float]:
    """Return all times at which something happened."""
    events = [e.at_s for e in session.events if e.channel not in QUIET_CHANNELS and not _is_answer(e)]
    frames = [one.at_s for one in session.frames if _matters(one)]
    return [*events, *frames, *_pauses([one.at_s for one in session.poses]), session.ends_at_s]


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
        cuts=[cut],
    )


def _spliced(items: Sequence[Timed], cut: Cut) -> list[Timed]:
    """Drop what lies in the cut, and bring forward what comes after it."""
    kept = [one for one in items if one.at_s < cut.at_s]
    later = [one for one in items if one.at_s >= cut.at_s + cut.for_s]
    return kept + [replace(one, at_s=one.at_s - cut.for_s) for one in later]
