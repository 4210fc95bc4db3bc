"""The sending end of a TCP connection as Linux has it, reduced to what decides when lost bytes arrive; pure.

- Loss detection: a segment counts as lost when one that was sent after it is acknowledged and a round trip and a
  quarter have passed (RACK, RFC 8985; selective acknowledgements, RFC 2018). A tail of the flight is probed (its TLP).
- Time-out: round trip + 0.2 s (Linux' TCP_RTO_MIN) after the last progress, doubled each time (RFC 6298).
- Congestion window: 10 segments at first (RFC 6928), 0.7 of it after a loss (CUBIC, RFC 9438), 1 after a time-out, then
  slow start. What does not fit waits, and is sent in full segments. This is what makes TCP stall over a link that loses
  at random.

Not modelled: delayed acknowledgements, retransmissions that were not needed, CUBIC's growth, pacing.
"""

import heapq
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

SEGMENT_BYTES = 1448
"""Payload of a full segment over Ethernet."""
MIN_TIMEOUT_S = 0.2
LONGEST_TIMEOUT_S = 120.0
"""Linux' TCP_RTO_MAX."""
FIRST_WINDOW, LEAST_WINDOW, BACK_OFF = 10.0, 2.0, 0.7
_PROBE_SLACK_S = 0.002


@dataclass(eq=False)
class Segment:
    """Bytes that are sent, and sent again, as one."""

    number: int
    data: bytes
    sent_s: float = -1.0
    """Begin of its last transmission; negative before the first."""
    arrives_s: float = math.inf
    """First arrival at the other end."""
    acknowledged: bool = False
    lost: bool = False
    """The sender counts it as lost and has not sent it again."""


class _Event(Enum):
    ACKNOWLEDGED = 1
    FOUND_LOST = 2
    TIMER = 3


@dataclass(frozen=True)
class Transmission:
    """One way of a segment over the network; infinite times for what is lost."""

    arrives_s: float = math.inf
    acknowledged_s: float = math.inf
    """Arrival of the acknowledgement at the sender."""


LOST = Transmission()


class TcpSender:
    """The sender of one direction; `write` bytes, and `advance` time. `network` carries a segment sent at a time."""

    def __init__(self, network: Callable[[Segment, float], Transmission]) -> None:
        self._network = network
        self._unsent: deque[bytes] = deque()
        self._flight: deque[Segment] = deque()
        self._window, self._threshold = FIRST_WINDOW, math.inf
        self._recovers_to = -1
        """Number of the segment whose acknowledgement ends the recovery from a loss; -1 without one."""
        self._probed = False
        self._timeouts = 0
        self._round_trip_s, self._least_round_trip_s = 0.0, math.inf
        self._events: list[tuple[float, int, _Event, Segment | None, float]] = []
        self._order = self._number = self._timer = 0

    @property
    def unsent_bytes(self) -> int:
        """Return the number of bytes that wait for the window."""
        return sum(map(len, self._unsent))

    @property
    def next_s(self) -> float:
        """Return the time of the next event; infinite when nothing is under way."""
        return self._events[0][0] if self._events else math.inf

    def write(self, now_s: float, data: bytes) -> None:
        """Send bytes, or let them wait for the window."""
        self._unsent += [data[start : start + SEGMENT_BYTES] for start in range(0, len(data), SEGMENT_BYTES)]
        self._send(now_s)

    def advance(self, now_s: float) -> None:
        """Do what acknowledgements and timers until `now_s` tell it to."""
        while self._events and self._events[0][0] <= now_s:
            at_s, number, event, segment, stamp_s = heapq.heappop(self._events)
            if event is _Event.ACKNOWLEDGED:
                self._acknowledge(at_s, arrived_s=stamp_s)
            elif event is _Event.TIMER and number == self._timer:
                self._time_out(at_s)
            elif segment is not None and segment.sent_s == stamp_s and not segment.acknowledged:
                self._count_as_lost(segment)
                self._send(at_s)

    # -- sending ---------------------------------------------------------------------------------

    def _send(self, now_s: float) -> None:
        """Send what the window allows: lost segments first, then what was never sent."""
        idle = not self._flight
        while self._in_flight < int(self._window):
            lost = next((one for one in self._flight if one.lost), None)
            if lost is None and not self._unsent:
                break
            self._transmit(lost or self._next_segment(), now_s)
            if idle or self._may_probe:  # a probe follows the last transmission, a time-out the last progress
                self._arm(now_s)
            idle = False

    @property
    def _in_flight(self) -> int:
        return sum(not (one.acknowledged or one.lost) for one in self._flight)

    def _next_segment(self) -> Segment:
        """Take as many bytes as one segment holds from what waits."""
        data = self._unsent.popleft()
        while self._unsent and len(data) + len(self._unsent[0]) <= SEGMENT_BYTES:
            data += self._unsent.popleft()
        self._number += 1
        segment = Segment(self._number, data)
        self._flight.append(segment)
        return segment

    def _transmit(self, segment: Segment, now_s: float) -> None:
        way = self._network(segment, now_s)
        segment.sent_s, segment.lost = now_s, False
        segment.arrives_s = min(segment.arrives_s, way.arrives_s)
        if way.acknowledged_s < math.inf:
            self._schedule(_Event.ACKNOWLEDGED, way.acknowledged_s, segment, way.arrives_s)

    def _schedule(self, event: _Event, at_s: float, segment: Segment | None, stamp_s: float) -> int:
        self._order += 1
        heapq.heappush(self._events, (at_s, self._order, event, segment, stamp_s))
        return self._order

    # -- acknowledgements ------------------------------------------------------------------------

    def _acknowledge(self, now_s: float, arrived_s: float) -> None:
        """Take an acknowledgement that was sent at `arrived_s`: of all that had arrived by then."""
        new = [one for one in self._flight if one.arrives_s <= arrived_s and not one.acknowledged]
        if not new:
            return
        in_flight, newest_s = self._in_flight, max(one.sent_s for one in new)
        for one in new:
            one.acknowledged, one.lost = True, False
        self._measure(now_s - newest_s)
        progress = self._flight[0].acknowledged
        while self._flight and self._flight[0].acknowledged:
            self._flight.popleft()
        if progress:
            self._timeouts, self._probed = 0, False
            if not self._flight or self._flight[0].number > self._recovers_to:
                self._recovers_to = -1
            self._grow(in_flight)
        self._detect_losses(newest_s, now_s)
        self._send(now_s)
        if progress:
            self._arm(now_s)

    def _measure(self, round_trip_s: float) -> None:
        first = math.isinf(self._least_round_trip_s)
        self._least_round_trip_s = min(self._least_round_trip_s, round_trip_s)
        self._round_trip_s += (round_trip_s - self._round_trip_s) * (1.0 if first else 0.125)

    def _grow(self, in_flight: int) -> None:
        """Widen the window if it is used."""
        if self._window < self._threshold and self._window < 2 * in_flight:
            self._window += 1.0
        elif in_flight >= int(self._window):
            self._window += 1.0 / self._window

    def _detect_losses(self, newest_s: float, now_s: float) -> None:
        """Count as lost what was sent before `newest_s`, when that was acknowledged, now or a little later."""
        patience_s = 0.0 if self._recovers_to >= 0 else 0.25 * self._least_round_trip_s
        for one in self._flight:
            if math.isinf(one.arrives_s) and not one.lost and one.sent_s < newest_s:
                lost_s = one.sent_s + (now_s - newest_s) + patience_s
                if lost_s <= now_s:
                    self._count_as_lost(one)
                else:
                    self._schedule(_Event.FOUND_LOST, lost_s, one, one.sent_s)

    def _count_as_lost(self, segment: Segment) -> None:
        segment.lost = True
        if self._recovers_to < 0:
            self._back_off()
            self._window = self._threshold

    def _back_off(self) -> None:
        self._threshold = max(BACK_OFF * self._window, LEAST_WINDOW)
        self._recovers_to = self._flight[-1].number

    # -- timers ----------------------------------------------------------------------------------

    def _arm(self, now_s: float) -> None:
        """Begin to wait for progress anew, if anything is in flight."""
        self._timer = 0
        if self._flight:
            after_s = (MIN_TIMEOUT_S + self._round_trip_s) * 2.0**self._timeouts
            if self._may_probe and self._in_flight > 1:
                after_s = min(2.0 * self._round_trip_s + _PROBE_SLACK_S, after_s)
            self._timer = self._schedule(_Event.TIMER, now_s + min(after_s, LONGEST_TIMEOUT_S), None, now_s)

    @property
    def _may_probe(self) -> bool:
        return self._recovers_to < 0 and not self._probed

    def _time_out(self, now_s: float) -> None:
        """Probe the tail of the flight; after that begin again with one segment."""
        if self._may_probe:
            self._probed = True
            self._transmit(self._next_segment() if self._unsent else self._flight[-1], now_s)
        else:
            if self._timeouts == 0:
                self._back_off()
            self._timeouts += 1
            self._window = 1.0
            for one in self._flight:
                one.lost = not one.acknowledged and math.isinf(one.arrives_s)
            self._transmit(self._flight[0], now_s)
        self._arm(now_s)
