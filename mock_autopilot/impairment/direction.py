"""One direction of an impaired link for datagrams: takes those that were sent, returns those that arrive; pure."""

import heapq
import math
from dataclasses import dataclass
from random import Random
from typing import Generic, TypeVar

from mock_autopilot.impairment.bursts import Bursts
from mock_autopilot.impairment.model import CLEAN, Impairment

Item = TypeVar("Item")
QUEUE_S = 0.2
"""Longest wait for a limited rate; what would wait longer is lost, as in a full queue."""
OVERTAKEN_WITHIN_S = 0.1
"""A datagram that is to be overtaken waits so long for a successor."""
SLACK_S = 1e-9


@dataclass
class Counts:
    """Number and bytes of what was sent, lost, and has arrived; the rest is on its way."""

    sent: int = 0
    lost: int = 0
    arrived: int = 0
    sent_bytes: int = 0
    arrived_bytes: int = 0

    def __str__(self) -> str:
        share = f" ({100.0 * self.lost / self.sent:.1f}%)" if self.lost else ""
        return f"{self.sent} sent ({self.sent_bytes} bytes), {self.lost} lost{share}, {self.arrived} arrived"


class ImpairedDirection(Generic[Item]):
    """One direction of a link; `put` what is sent, and ask with `due` for what has arrived.

    In order: the rate's queue, loss, delay and jitter, duplicates, reordering. Each datagram has a jitter of its own,
    so one with a small jitter overtakes one sent before it with a large one. A datagram is reordered by waiting until
    its successor has arrived. The seed decides everything: the same datagrams are lost whatever the other impairments
    are. Directions with the same `burst_seed` (without one: `seed`) are cut at the same times, as by a fading radio.
    """

    def __init__(self, impairment: Impairment, seed: int = 1, burst_seed: int | None = None) -> None:
        self._rng, self._duplicate_rng = Random(seed), Random(f"{seed} duplicates")
        self._burst_seed = seed if burst_seed is None else burst_seed
        self._impairment, self._bursts = CLEAN, Bursts()
        self._queue: list[tuple[float, int, int, Item]] = []
        self._overtaken: tuple[float, int, Item] | None = None
        self._free_s = -math.inf
        self._order = 0
        self.counts = Counts()
        """What passed and what was lost so far."""
        self.set(impairment)

    @property
    def impairment(self) -> Impairment:
        """Return the present impairment."""
        return self._impairment

    def set(self, impairment: Impairment) -> None:
        """Change the impairment; what is on its way arrives as it would have."""
        before, self._impairment = self._impairment, impairment
        if (before.burst_share, before.burst_s) != (impairment.burst_share, impairment.burst_s):
            self._bursts = Bursts(impairment.burst_share, impairment.burst_s, self._burst_seed)
        if math.isinf(impairment.rate_bytes_per_s):
            self._free_s = -math.inf

    def put(self, now_s: float, item: Item, size_bytes: int | None = None) -> None:
        """Send one datagram at `now_s` (s, any clock that does not go back); bytes know their size."""
        size = size_bytes if size_bytes is not None else len(item) if isinstance(item, bytes | bytearray) else 0
        self.counts.sent += 1
        self.counts.sent_bytes += size
        lost, jitter, overtaken = (self._rng.random() for _ in range(3))  # always three: effects do not shift another
        one = self._impairment
        sent_s = self._through_queue(now_s, size)
        if sent_s is None or lost < one.loss_share or self._bursts.covers(now_s):
            self.counts.lost += 1
            return
        arrives_s = sent_s + one.delay_s + one.jitter_s * jitter
        if one.duplicate_share and self._duplicate_rng.random() < one.duplicate_share:
            self._push(sent_s + one.delay_s + one.jitter_s * self._duplicate_rng.random(), size, item)
        if self._overtaken is not None:
            held_s, held_size, held = self._overtaken
            self._overtaken = None
            self._push(arrives_s, size, item)
            self._push(max(held_s, arrives_s), held_size, held)
        elif overtaken < one.reorder_share / (1.0 - one.reorder_share):  # its successor never waits, too
            self._overtaken = arrives_s, size, item
        else:
            self._push(arrives_s, size, item)

    def _through_queue(self, now_s: float, size_bytes: int) -> float | None:
        """Return the time at which it has left the sender; None when the queue is full."""
        begin_s = max(now_s, self._free_s)
        if begin_s - now_s > QUEUE_S:
            return None
        leaves_s = begin_s + size_bytes / self._impairment.rate_bytes_per_s
        self._free_s = leaves_s if math.isfinite(self._impairment.rate_bytes_per_s) else -math.inf
        return leaves_s

    def _push(self, arrives_s: float, size_bytes: int, item: Item) -> None:
        self._order += 1
        heapq.heappush(self._queue, (arrives_s, self._order, size_bytes, item))

    def due(self, now_s: float) -> list[Item]:
        """Return what has arrived by `now_s`, in the order of arrival, each once."""
        if self._overtaken is not None and self._overtaken[0] + OVERTAKEN_WITHIN_S <= now_s + SLACK_S:
            (held_s, size, item), self._overtaken = self._overtaken, None
            self._push(held_s + OVERTAKEN_WITHIN_S, size, item)
        arrived = []
        while self._queue and self._queue[0][0] <= now_s + SLACK_S:
            _, _, size, item = heapq.heappop(self._queue)
            self.counts.arrived += 1
            self.counts.arrived_bytes += size
            arrived.append(item)
        return arrived

    @property
    def next_s(self) -> float:
        """Return the time of the next arrival if nothing more is sent; infinite when nothing is on its way."""
        held_s = math.inf if self._overtaken is None else self._overtaken[0] + OVERTAKEN_WITHIN_S
        return min(held_s, self._queue[0][0]) if self._queue else held_s
