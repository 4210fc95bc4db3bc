"""One direction of an impaired link for a TCP connection: bytes in order, where a loss becomes a delay; pure.

The model is a sender with selective acknowledgements and the loss detection of RFC 8985 (RACK), as Linux has it: a lost
segment is sent again when a segment sent after it has been acknowledged (and at least a round trip and a quarter of it
have passed), else after the retransmission time-out, which is the round trip + 0.2 s (Linux' TCP_RTO_MIN), and doubles
(RFC 6298). Not modelled: congestion control, lost acknowledgements, tail loss probes, the handshake.
"""

import heapq
import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from random import Random

from mock_autopilot.impairment.bursts import Bursts
from mock_autopilot.impairment.direction import SLACK_S, Counts
from mock_autopilot.impairment.model import CLEAN, Impairment

SEGMENT_BYTES = 1448
"""Payload of a full segment over Ethernet."""
MIN_TIMEOUT_S = 0.2
"""Linux' TCP_RTO_MIN: the least that is added to the round trip."""
LONGEST_TIMEOUT_S = 120.0
"""Linux' TCP_RTO_MAX."""


class _Event(Enum):
    ACKNOWLEDGED = 1
    """The sender learns that this transmission has arrived."""
    FOUND_LOST = 2
    TIMED_OUT = 3


@dataclass(eq=False)
class _Segment:
    data: bytes
    sent_s: float = 0.0
    """Begin of its last transmission."""
    arrives_s: float = math.inf
    """Arrival of the transmission that gets through."""
    timeouts: int = 0


class ImpairedStream:
    """One direction of a TCP connection; `put` what is written, and ask with `due` for what can be read."""

    def __init__(self, impairment: Impairment, seed: int = 1, burst_seed: int | None = None) -> None:
        self._rng, self._burst_seed = Random(seed), seed if burst_seed is None else burst_seed
        self._impairment, self._bursts = CLEAN, Bursts()
        self._line: deque[_Segment] = deque()
        self._events: list[tuple[float, int, _Event, _Segment, float]] = []
        self._free_s = -math.inf
        self._order = 0
        self.waiting_bytes = 0
        """Bytes that were put and are not due yet."""
        self.counts = Counts()
        """Segments that were sent, again or for the first time; lost; and read."""
        self.set(impairment)

    @property
    def impairment(self) -> Impairment:
        """Return the present impairment."""
        return self._impairment

    def set(self, impairment: Impairment) -> None:
        """Change the impairment for all segments that are sent, or sent again, after this."""
        before, self._impairment = self._impairment, impairment
        if (before.burst_share, before.burst_s) != (impairment.burst_share, impairment.burst_s):
            self._bursts = Bursts(impairment.burst_share, impairment.burst_s, self._burst_seed)
        if math.isinf(impairment.rate_bytes_per_s):
            self._free_s = -math.inf

    def put(self, now_s: float, data: bytes) -> None:
        """Write bytes at `now_s` (s, any clock that does not go back)."""
        self._advance(now_s)
        for start in range(0, len(data), SEGMENT_BYTES):
            segment = _Segment(data[start : start + SEGMENT_BYTES])
            self.waiting_bytes += len(segment.data)
            self._line.append(segment)
            self._transmit(segment, now_s)

    def due(self, now_s: float) -> list[bytes]:
        """Return what can be read at `now_s`: in the order written, and nothing before what was written earlier."""
        self._advance(now_s)
        arrived = []
        while self._line and self._line[0].arrives_s <= now_s + SLACK_S:
            data = self._line.popleft().data
            self.waiting_bytes -= len(data)
            self.counts.arrived += 1
            self.counts.arrived_bytes += len(data)
            arrived.append(data)
            self._expect_first()
        return arrived

    @property
    def next_s(self) -> float:
        """Return the time at which to ask again if nothing more is written; infinite when nothing is on its way."""
        arrival_s = self._line[0].arrives_s if self._line else math.inf
        return min(arrival_s, self._events[0][0]) if self._line and self._events else arrival_s

    def _transmit(self, segment: _Segment, now_s: float) -> None:
        one, size = self._impairment, len(segment.data)
        self.counts.sent += 1
        self.counts.sent_bytes += size
        lost, jitter = self._rng.random(), self._rng.random()
        leaves_s = max(now_s, self._free_s) + size / one.rate_bytes_per_s
        self._free_s = leaves_s if math.isfinite(one.rate_bytes_per_s) else -math.inf
        segment.sent_s = leaves_s
        if lost < one.loss_share or self._bursts.covers(now_s):
            self.counts.lost += 1
            if segment is self._line[0]:
                self._expect_first()
            return
        segment.arrives_s = leaves_s + one.delay_s + one.jitter_s * jitter
        self._schedule(_Event.ACKNOWLEDGED, segment.arrives_s + self._one_way_s, segment)

    @property
    def _one_way_s(self) -> float:
        """Return the mean delay, which stands for that of the way back, too."""
        return self._impairment.delay_s + 0.5 * self._impairment.jitter_s

    def _expect_first(self) -> None:
        """Let the first unread segment be sent again at its time-out, if it was lost."""
        if self._line and math.isinf(self._line[0].arrives_s):
            first = self._line[0]
            timeout_s = min((MIN_TIMEOUT_S + 2.0 * self._one_way_s) * 2.0**first.timeouts, LONGEST_TIMEOUT_S)
            self._schedule(_Event.TIMED_OUT, first.sent_s + timeout_s, first)

    def _schedule(self, event: _Event, at_s: float, segment: _Segment) -> None:
        self._order += 1
        heapq.heappush(self._events, (at_s, self._order, event, segment, segment.sent_s))

    def _advance(self, now_s: float) -> None:
        """Let the sender do what acknowledgements and time-outs until `now_s` tell it to."""
        while self._events and self._events[0][0] <= now_s + SLACK_S:
            at_s, _, event, segment, sent_s = heapq.heappop(self._events)
            if event is _Event.ACKNOWLEDGED:
                self._detect_losses(sent_s, at_s)
            elif math.isinf(segment.arrives_s) and segment.sent_s == sent_s:  # not sent again meanwhile
                segment.timeouts += event is _Event.TIMED_OUT
                self._transmit(segment, at_s)

    def _detect_losses(self, sent_s: float, now_s: float) -> None:
        """Send again what was lost and sent before `sent_s`, when that transmission is acknowledged at `now_s`."""
        round_trip_s = now_s - sent_s
        for segment in self._line:
            if math.isinf(segment.arrives_s) and segment.sent_s < sent_s:
                again_s = max(now_s, segment.sent_s + 1.25 * round_trip_s)
                self._schedule(_Event.FOUND_LOST, again_s, segment)
