"""Recorded events beside the mock's: matched in order, channel by channel, and held against the recorded spread."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import groupby

from tests.mock_autopilot.reenact.events import Event
from tests.mock_autopilot.reenact.player import Played
from tests.mock_autopilot.reenact.session import GCS
from tests.mock_autopilot.reenact.tolerances import DISARMING, Tolerance, tolerance_of

GCS_CHANNELS = {"STATUSTEXT", "COMMAND_ACK"}
"""All that is compared on the ground station's link: rates and requests there are its own."""
LANDED, DISARMED, SOON_S = "6: Landing detected", "Disarmed by external command", 0.6
ANSWERS = {"COMMAND_ACK", "reply", "PARAM_VALUE"}
PERIODS_S = {
    "HEARTBEAT": 1.05, "EXTENDED_SYS_STATE": 1.05, "ESTIMATOR_STATUS": 1.05, "CURRENT_MODE": 0.055, "SYS_STATUS": 0.21,
    "BATTERY_STATUS": 2.05,
}  # fmt: skip
"""Rates of the messages that repeat a state, as the companion asked for them."""
STATES = {"HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE", "BATTERY_STATUS"}
RUNS = re.compile(r"Disarming denied: not landed|ARM_DISARM TEMPORARILY_REJECTED")
"""Asked again and again until it is granted: however often that takes, it is one event."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the comparison; a time is None where the event is missing."""

    link: str
    channel: str
    what: str
    recorded_s: float | None
    mock_s: float | None
    expected_s: float | None
    tolerance: Tolerance
    brief: bool = False
    """Gone again before its message was sent once more."""

    @property
    def off_s(self) -> float:
        """Return the mock's delay against the expected time, s."""
        return 0.0 if self.mock_s is None or self.expected_s is None else self.mock_s - self.expected_s

    @property
    def verdict(self) -> str:
        if self.mock_s is None or self.recorded_s is None:
            if self.tolerance.optional or self.brief:
                return "by chance"
            return "MISSING" if self.mock_s is None else "EXTRA"
        if self.off_s < -self.tolerance.early_s:
            return "EARLY"
        return "LATE" if self.off_s > self.tolerance.late_s else "as recorded"

    @property
    def differs(self) -> bool:
        return self.verdict not in {"as recorded", "by chance"}


def compare(recorded: Sequence[Event], played: Played) -> list[Row]:
    """Return a row for every event of either, in the order of time; nothing that may have come after the recording."""
    rows = []
    links = {event.link for event in recorded}
    for key in _keys([*recorded, *(event for event in played.events if event.link in links)]):
        theirs, ours = _of(key, recorded), _of(key, played.events)
        rows += _rows(theirs, ours, played)
    rows = [row for row in rows if not (row.differs and row.what == LANDED and _disarmed_soon(row, rows))]
    rows = [row for row in rows if row.recorded_s is not None or not _may_come_later(row, played)]
    return sorted(rows, key=lambda row: row.recorded_s if row.recorded_s is not None else row.mock_s or 0.0)


def _may_come_later(row: Row, played: Played) -> bool:
    return row.mock_s is not None and row.mock_s + row.tolerance.early_s >= played.expected_s(played.ends_at_s)


def _disarmed_soon(landed: Row, rows: Sequence[Row]) -> bool:
    """Asked to disarm all the time, PX4 grants it as soon as it has landed, often before it says that it has."""
    at_s = landed.recorded_s if landed.recorded_s is not None else landed.mock_s or 0.0
    disarmed_s = [
        row.recorded_s if landed.recorded_s is not None else row.mock_s for row in rows if DISARMED in row.what
    ]
    return any(at_s <= one_s <= at_s + SOON_S for one_s in disarmed_s if one_s is not None)


Key = tuple[str, str, str]


def _keys(events: Sequence[Event]) -> list[Key]:
    keys = dict.fromkeys(_key(event) for event in events)
    return [key for key in keys if key[0] != GCS or key[1] in GCS_CHANNELS]


def _key(event: Event) -> Key:
    """Link, channel and what it is about: a mode is followed from state to state, everything else by itself.

    What must come in which order is then said by the times alone.
    """
    about = event.what
    if event.channel in STATES:
        about = ""
    elif event.channel == "COMMAND_ACK":
        about = event.what.split()[0]
    elif event.channel in {"SYS_STATUS", "ESTIMATOR_STATUS"}:
        about = re.sub("[+-]", "", event.what)
    return event.link, event.channel, about


def _of(key: Key, events: Sequence[Event]) -> list[Event]:
    """Return one key's events, each run of the same refusal as one."""
    mine = [event for event in events if _key(event) == key]
    grouped = [list(group) for _, group in groupby(enumerate(mine), key=lambda pair: _run(*pair))]
    return [group[0][1] for group in grouped]


def _run(index: int, event: Event) -> str:
    return "run" if RUNS.search(event.what) else str(index)


def _rows(theirs: Sequence[Event], ours: Sequence[Event], played: Played) -> list[Row]:
    matcher = SequenceMatcher(None, [e.what for e in theirs], [e.what for e in ours], autojunk=False)
    rows = []
    for tag, i1, i2, j1, j2 in matcher.get_opcodes():
        if tag == "equal":
            rows += [_row(a, b, played) for a, b in zip(theirs[i1:i2], ours[j1:j2], strict=True)]
        else:
            rows += [
                _row(theirs[i], None, played, _is_brief(theirs, i) or played.skips(theirs[i])) for i in range(i1, i2)
            ]
            rows += [_row(None, ours[j], played, _is_brief(ours, j)) for j in range(j1, j2)]
    return rows


def _is_brief(events: Sequence[Event], index: int) -> bool:
    """Return whether a state was over before its message was due once more: it may fall between two samples."""
    event, after = events[index], events[index + 1 : index + 2]
    return bool(after) and after[0].at_s - event.at_s <= PERIODS_S.get(event.channel, 0.0)


def _row(theirs: Event | None, ours: Event | None, played: Played, brief: bool = False) -> Row:
    event = theirs or ours
    assert event is not None
    return Row(
        link=event.link,
        channel=event.channel,
        what=event.what,
        recorded_s=theirs.at_s if theirs else None,
        mock_s=ours.at_s if ours else None,
        expected_s=_expected_s(theirs, played) if theirs else None,
        tolerance=DISARMING
        if theirs and played.is_disarming(theirs) and event.channel in STATES
        else tolerance_of(event),
        brief=brief,
    )


def _expected_s(event: Event, played: Played) -> float:
    """Return when the mock is to tell it: an answer after its question, all else by the recording's clock."""
    answers = event.channel in ANSWERS and not event.what.startswith("ARM_DISARM")
    if played.is_disarming(event):
        return played.disarming_expected_s(event.at_s)
    return played.answer_expected_s(event.at_s) if answers else played.expected_s(event.at_s)


def table(rows: Sequence[Row]) -> str:
    """Return the rows as text, one a line."""
    lines = [f"{'recorded':>9} {'mock':>9} {'off':>7} {'accepted':>15}  {'verdict':<12} event"]
    for row in rows:
        accepted = f"{-row.tolerance.early_s:+.3f}..{row.tolerance.late_s:+.3f}"
        off = f"{row.off_s:+.3f}" if row.mock_s is not None and row.recorded_s is not None else ""
        where = f"{row.link} " if row.link == GCS else ""
        lines.append(
            f"{_time(row.recorded_s):>9} {_time(row.mock_s):>9} {off:>7} {accepted:>15}  {row.verdict:<12} "
            f"{where}{row.channel} {row.what}"
        )
    return "\n".join(lines)


def _time(at_s: float | None) -> str:
    return "-" if at_s is None else f"{at_s:.3f}"
