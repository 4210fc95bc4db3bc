"""State of the law's link as the vehicle sees it, and the counts of its last second. Pure."""

from collections import deque
from dataclasses import dataclass
from math import inf, nan
from statistics import median

_WINDOW_S = 1.0


@dataclass(frozen=True, kw_only=True)
class LinkStatus:
    """State of the link now."""

    connected: bool
    """A ground law has a session."""
    law: str
    """Name of the law on the ground; empty without a session."""
    host: str
    silence_s: float
    """Time since the newest valid message was sent by a ground law that has a pose; infinite before the first."""
    blind: bool
    """The ground law says that it has no fresh pose."""
    failed: bool
    """The ground law says that its law has failed."""
    age_s: float
    """Median age of the messages of the last second at their arrival; NaN while unknown."""
    received: int
    """Messages of the last second that arrived as the newest."""
    missing: int
    """Messages of the last second that have not arrived."""
    late: int
    """Messages of the last second that arrived after a newer one, and were dropped."""
    foreign: int
    """Datagrams of the last second with a wrong key or session, or played again; all dropped."""
    foreign_from: str
    """Sender of the newest of them."""
    rival: str
    """Another ground law that has asked for a session in the last second, and was refused; empty without one."""
    refused: str
    """Reason for which a ground law was refused last; empty after a session has begun."""
    session: int = 0
    """Number of the session; 0 without one."""
    round_trip_s: float = nan
    """Quickest round trip of the last seconds, as the ground measures it; NaN until the clocks are compared."""


NO_LINK = LinkStatus(
    connected=False,
    law="",
    host="",
    silence_s=inf,
    blind=False,
    failed=False,
    age_s=nan,
    received=0,
    missing=0,
    late=0,
    foreign=0,
    foreign_from="",
    rival="",
    refused="",
)
"""State before the first ground law."""


@dataclass(frozen=True, kw_only=True)
class UpCounts:
    """Messages that the ground law has sent in this session, by its own count."""

    messages: int = 0
    events: int = 0
    """New commands."""
    again: int = 0
    """Commands sent again, as known once a second."""
    sent_bytes: int = 0
    """Payload with tags, as known once a second."""
    received: int = 0
    """Messages that have arrived, late ones included."""
    received_bytes: int = 0

    @property
    def beats(self) -> int:
        """Messages without a command."""
        return self.messages - self.events - self.again

    @property
    def lost(self) -> int:
        """Messages that have not arrived so far."""
        return self.messages - self.received


class SecondCount:
    """Sum of numbers noted in the last second."""

    def __init__(self) -> None:
        self._noted: deque[tuple[float, int]] = deque()

    def note(self, now_s: float, number: int = 1) -> None:
        """Add a number."""
        self._noted.append((now_s, number))

    def sum(self, now_s: float) -> int:
        """Return the sum of the last second."""
        while self._noted and self._noted[0][0] <= now_s - _WINDOW_S:
            self._noted.popleft()
        return sum(number for _, number in self._noted)


class RecentAges:
    """Ages (s) of the messages of the last second."""

    def __init__(self) -> None:
        self._ages: deque[tuple[float, float]] = deque()

    def note(self, now_s: float, age_s: float) -> None:
        """Add the age of a message that has arrived now."""
        self._ages.append((now_s, age_s))
        while self._ages[0][0] <= now_s - _WINDOW_S:
            self._ages.popleft()

    @property
    def median_s(self) -> float:
        """Median; NaN without messages."""
        return median(age_s for _, age_s in self._ages) if self._ages else nan
