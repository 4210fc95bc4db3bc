"""Offset between the clocks of ground and vehicle, from messages that go round. Pure.

As in NTP (RFC 5905, section 8): the offset is exact if both ways take equally long, and wrong by at most half of the
round trip. The quickest round trip of the last seconds counts. Two exchanges that contradict each other show that a
clock has jumped, and what was known before is dropped.
"""

from dataclasses import dataclass
from math import inf, nan

HALF_WINDOW_S = 5.0
_DRIFT_S = 2e-3
"""Difference that two clocks may gain in the seconds of the window, and the resolution of stamps."""


@dataclass(frozen=True, kw_only=True)
class RoundTrip:
    """One exchange: sent and received by the ground, received and sent by the vehicle, each on its own clock (s)."""

    ground_sent_s: float
    vehicle_received_s: float
    vehicle_sent_s: float
    ground_received_s: float

    @property
    def round_trip_s(self) -> float:
        """Time on the way, both ways."""
        return (self.ground_received_s - self.ground_sent_s) - (self.vehicle_sent_s - self.vehicle_received_s)

    @property
    def offset_s(self) -> float:
        """Vehicle's clock less the ground's."""
        up_s = self.vehicle_received_s - self.ground_sent_s
        return 0.5 * (up_s + self.vehicle_sent_s - self.ground_received_s)


@dataclass(frozen=True, kw_only=True)
class ClockOffset:
    """Best exchange of the running half window and of the one before."""

    started_s: float = -inf
    running: RoundTrip | None = None
    previous: RoundTrip | None = None

    @property
    def best(self) -> RoundTrip | None:
        """Quickest exchange; None before the first."""
        known = [one for one in (self.running, self.previous) if one is not None]
        return min(known, key=lambda one: one.round_trip_s, default=None)

    @property
    def offset_s(self) -> float:
        """Vehicle's clock less the ground's, s; NaN before the first exchange."""
        return nan if self.best is None else self.best.offset_s

    @property
    def round_trip_s(self) -> float:
        """Quickest round trip of the last seconds; NaN before the first exchange."""
        return nan if self.best is None else self.best.round_trip_s

    def after(self, trip: RoundTrip) -> "ClockOffset":
        """Return the offset with one more exchange; a clock that has jumped begins again."""
        if trip.round_trip_s < -_DRIFT_S:
            return ClockOffset()
        best = self.best
        if best is not None:
            most_s = 0.5 * (trip.round_trip_s + best.round_trip_s) + _DRIFT_S
            if abs(trip.offset_s - best.offset_s) > most_s:
                return ClockOffset(started_s=trip.ground_received_s, running=trip)
        if trip.ground_received_s - self.started_s >= HALF_WINDOW_S:
            return ClockOffset(started_s=trip.ground_received_s, running=trip, previous=self.running)
        running = trip if self.running is None else min(self.running, trip, key=lambda one: one.round_trip_s)
        return ClockOffset(started_s=self.started_s, running=running, previous=self.previous)
