"""One direction of an impaired link for a TCP connection: bytes in order, where a loss becomes a delay; pure."""

import math
from collections import deque
from random import Random

from mock_autopilot.impairment.bursts import Bursts
from mock_autopilot.impairment.direction import SLACK_S, Counts
from mock_autopilot.impairment.model import CLEAN, Impairment
from mock_autopilot.impairment.tcp_sender import LOST, Segment, TcpSender, Transmission


class ImpairedStream:
    """One direction of a TCP connection; `put` what is written, and ask with `due` for what can be read.

    A lost segment is sent again as Linux' TCP does (`tcp_sender`), and whatever was written after it waits. Reordering
    and duplicates are left out, and a rate makes bytes wait instead of losing them.
    """

    def __init__(self, impairment: Impairment, seed: int = 1, burst_seed: int | None = None) -> None:
        self._rng, self._burst_seed = Random(seed), seed if burst_seed is None else burst_seed
        self._impairment = self._back = CLEAN
        self._bursts = self._bursts_back = Bursts()
        self._unread: deque[Segment] = deque()
        self._free_s = -math.inf
        self._sender = TcpSender(self._carry)
        self.counts = Counts()
        """Segments that were sent, again or for the first time; lost; and read."""
        self.set(impairment)

    @property
    def impairment(self) -> Impairment:
        """Return the present impairment."""
        return self._impairment

    @property
    def waiting_bytes(self) -> int:
        """Return the number of bytes that were put and are not due yet."""
        return self._sender.unsent_bytes + sum(len(segment.data) for segment in self._unread)

    def set(self, impairment: Impairment, back: Impairment | None = None) -> None:
        """Change the impairment, and that of the acknowledgements: `back`, or the same.

        It concerns all that is sent, or sent again, after this.
        """
        self._impairment, self._back = impairment, back or impairment
        self._bursts = Bursts(impairment.burst_share, impairment.burst_s, self._burst_seed)
        self._bursts_back = Bursts(self._back.burst_share, self._back.burst_s, self._burst_seed)
        if math.isinf(impairment.rate_bytes_per_s):
            self._free_s = -math.inf

    def put(self, now_s: float, data: bytes) -> None:
        """Write bytes at `now_s` (s, any clock that does not go back)."""
        self._sender.advance(now_s)
        self._sender.write(now_s, data)

    def due(self, now_s: float) -> list[bytes]:
        """Return what can be read at `now_s`: in the order written, and nothing before what was written earlier."""
        self._sender.advance(now_s + SLACK_S)
        arrived = []
        while self._unread and self._unread[0].arrives_s <= now_s + SLACK_S:
            data = self._unread.popleft().data
            self.counts.arrived += 1
            self.counts.arrived_bytes += len(data)
            arrived.append(data)
        return arrived

    @property
    def next_s(self) -> float:
        """Return the time at which to ask again if nothing more is written; infinite when nothing is on its way."""
        if not self._unread:
            return self._sender.next_s if self._sender.unsent_bytes else math.inf
        return min(self._unread[0].arrives_s, self._sender.next_s)

    def _carry(self, segment: Segment, now_s: float) -> Transmission:
        """Carry a segment over the link, and its acknowledgement back."""
        one, size = self._impairment, len(segment.data)
        if segment.sent_s < 0.0:
            self._unread.append(segment)
        self.counts.sent += 1
        self.counts.sent_bytes += size
        lost, jitter, lost_back, jitter_back = (self._rng.random() for _ in range(4))
        leaves_s = max(now_s, self._free_s) + size / one.rate_bytes_per_s
        self._free_s = leaves_s if math.isfinite(one.rate_bytes_per_s) else -math.inf
        if lost < one.loss_share or self._bursts.covers(now_s):
            self.counts.lost += 1
            return LOST
        arrives_s = leaves_s + one.delay_s + one.jitter_s * jitter
        if lost_back < self._back.loss_share or self._bursts_back.covers(arrives_s):
            return Transmission(arrives_s)
        return Transmission(arrives_s, arrives_s + self._back.delay_s + self._back.jitter_s * jitter_back)
