"""Conversion of the motion-capture system's stamps to the service's monotonic clock.

A frame arrives after a fixed delay plus some waiting, never earlier: so the smallest (arrival - stamp) of the last
seconds, less the known fixed delay, is the offset between the clocks.
"""

from dataclasses import dataclass
from math import inf
from typing import cast

from companion.core.types import Flag
from companion.geometry.array_math import where


@dataclass(frozen=True)
class ClockSync:
    """Smallest arrival - stamp (s) of the running and of the previous half window."""

    started_s: float = -inf
    """Arrival that began the running half window."""
    running_s: float = inf
    previous_s: float = inf
    last_stamp_s: float = -inf

    @property
    def offset_s(self) -> float:
        """Offset of the service's clock against the stamps (s), the fixed delay included."""
        return cast(float, where(self.previous_s < self.running_s, self.previous_s, self.running_s))


def observe(sync: ClockSync, stamp_s: float, received_s: float, window_s: float = 10.0) -> ClockSync:
    """Update with one frame; the memory reaches half to one `window_s` back, so drifting clocks are followed.

    A stamp that goes back belongs to a new measurement with a new zero: the old offset is discarded at once. A stamp
    that merely arrives later counts only after the window has passed: that is a delay, not a new clock.
    """
    if stamp_s < sync.last_stamp_s:
        return ClockSync(received_s, received_s - stamp_s, inf, stamp_s)
    return observe_later(sync, stamp_s, received_s, window_s)


def observe_later(sync: ClockSync, stamp_s: float, received_s: float, window_s: float) -> ClockSync:
    """Update as `observe` does, with a frame whose stamp does not go back."""
    seen_s = received_s - stamp_s
    begins = received_s - sync.started_s >= 0.5 * window_s
    started_s, previous_s = where(begins, received_s, sync.started_s), where(begins, sync.running_s, sync.previous_s)
    running_s = where(begins | (seen_s < sync.running_s), seen_s, sync.running_s)
    return ClockSync(cast(float, started_s), cast(float, running_s), cast(float, previous_s), stamp_s)


def is_ahead(sync: ClockSync, stamp_s: float, received_s: float, by_s: float) -> Flag:
    """Return True if the stamp is more than `by_s` later than is possible for a frame that has already arrived.

    No network delay explains that: the clock of the stamps has jumped. `observe` would take it for the shortest delay.
    """
    return (sync.offset_s < inf) & (received_s - stamp_s < sync.offset_s - by_s)


def to_local_s(sync: ClockSync, stamp_s: float, delay_s: float) -> float:
    """Return the capture time on the service's clock; `delay_s` is the least time from capture to arrival."""
    return stamp_s + sync.offset_s - delay_s
