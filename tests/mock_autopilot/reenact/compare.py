"""Recorded events beside the mock's: matched in order, channel by channel, and held against the recorded spread."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import groupby

from tests.mock_autopilot.reenact.events import Event
from tests.mock_autopilot.reenact.player import Played
from tests.mock_autopilot.reenact.session import GCS
from tests.mock_autopilot.reenact.tolerances import Tolerance, tolerance_of

GCS_CHANNELS = {"STATUSTEXT", "COMMAND_ACK"}
"""All that is compared on the ground station's link: rates and requests there are its own."""
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

    @property
    def off_s(self) -> float:
        """How much later than expected the mock told it."""
        return 0.0 if self.mock_s is None or self.expected_s is None else self.mock_s - self.expected_s

    @property
    def verdict(self) -> str:
        if self.mock_s is None or self.recorded_s is None:
            if self.tolerance.optional:
                return "by chance"
            return "MISSING" if self.mock_s is None else "EXTRA"
        if self.off_s < -self.tolerance.early_s:
            return "EARLY"
        return "LATE" if self.off_s > self.tolerance.late_s else "as recorded"

    @property
    def differs(self) -> bool:
        return self.verdict not in {"as recorded", "by chance"}


def compare(recorded: Sequence[Event], played: Played) -> list[Row]:
    """Return a row for every event of either, in the order of time."""
    rows = []
    links = {event.link for event in recorded}
    for key in _keys([*recorded, *(event for event in played.events if event.link in links)]):
        theirs, ours = _of(key, recorded), _of(key, played.events)
        rows += _rows(theirs, ours, played)
    return sorted(rows, key=lambda row: row.recorded_s if row.recorded_s is not None else row.mock_s or 0.0)


def _keys(events: Sequence[Event]) -> list[tuple[str, str]]:
    keys = dict.fromkeys((event.link, event.channel) for event in events)
    return [(link, channel) for link, channel in keys if link != GCS or channel in GCS_CHANNELS]


def _of(key: tuple[str, str], events: Sequence[Event]) -> list[Event]:
    """Return one channel's events, each run of the same refusal as one."""
    mine = [event for event in events if (event.link, event.channel) == key]
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
            rows += [_row(a, None, played) for a in theirs[i1:i2]] + [_row(None, b, played) for b in ours[j1:j2]]
    return rows


def _row(theirs: Event | None, ours: Event | None, played: Played) -> Row:
    event = theirs or ours
    assert event is not None
    return Row(
        link=event.link,
        channel=event.channel,
        what=event.what,
        recorded_s=theirs.at_s if theirs else None,
        mock_s=ours.at_s if ours else None,
        expected_s=played.expected_s(theirs.at_s) if theirs else None,
        tolerance=tolerance_of(event),
    )


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
