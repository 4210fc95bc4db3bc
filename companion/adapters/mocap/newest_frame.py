"""The slot that holds a motion-capture source's newest frame, and the counts of those that never made it there."""

import asyncio
import logging
from dataclasses import dataclass, replace

from companion.core.interfaces import Clock, MocapError
from companion.core.types import MocapFrame

LOG = logging.getLogger(__name__)

RESTART_S = 0.2
"""A stamp that goes back further than this is a new measurement, not a frame that was overtaken.

Less would do for a network; more would turn a clock that jumped back into silence.
"""
_DOUBT = 3
"""Valid frames that are dropped after an unreadable packet.

TCP and UDP have checksums: a source of broken packets sends wrong numbers in readable ones, too.
"""
_MOST_DOUBT = 10


@dataclass(frozen=True)
class MocapCounts:
    """Counts of frames received, used and dropped."""

    received: int = 0
    """Frames that were newer than all before them."""
    lost: int = 0
    """Frame numbers that were skipped, those of doubted frames among them."""
    late: int = 0
    """Frames dropped because a newer one, or the same, was already here."""
    malformed: int = 0
    doubted: int = 0
    """Frames dropped because such packets came just before."""


class NewestFrame:
    """Base of mocap sources: the transport calls `put`, `on_malformed` and `fail`."""

    def __init__(self, where: str, clock: Clock) -> None:
        """`where` begins the sentences that say what it did: 'QTM at ...'."""
        self.counts = MocapCounts()
        self._where, self._clock = where, clock
        self._doubt = 0
        self._latest: MocapFrame | None = None
        self._unseen = False
        self._failure: str | None = None
        self._waiter: asyncio.Future[None] | None = None

    def latest(self) -> MocapFrame | None:
        """Return the newest frame, or None before the first one."""
        return self._latest

    async def wait_frame(self, timeout_s: float) -> bool:
        """Wait for a frame newer than the last returned; False on time-out. MocapError once the source is closed."""
        fresh = await self.wait_unseen(timeout_s)
        self._unseen = False
        return fresh

    async def wait_unseen(self, timeout_s: float) -> bool:
        """Wait like `wait_frame`, but leave the frame for the next `wait_frame`."""
        if not self._unseen and self._failure is None:
            await self._woken(timeout_s)
        if self._failure is not None:
            raise MocapError(self._failure)
        return self._unseen

    def why_silent(self) -> str:
        """Return why no frames come: here that is not known."""
        return ""

    def is_overtaken(self, number: int, stamp_s: float) -> bool:
        """Return True, and count the frame as late, when the same frame or a newer one was received before.

        The order is that of capture: some QTM versions number every live frame 1.
        """
        last = self._latest
        if last is None or stamp_s < last.stamp_s - RESTART_S or (stamp_s, number) > (last.stamp_s, last.frame):
            return False
        self.counts = replace(self.counts, late=self.counts.late + 1)
        return True

    def put(self, frame: MocapFrame) -> None:
        """Take a frame that is not overtaken, unless it is in doubt."""
        if self._doubt > 0:
            self._doubt -= 1
            self.counts = replace(self.counts, doubted=self.counts.doubted + 1)
            return
        skipped = max(0, frame.frame - self._latest.frame - 1) if self._latest is not None else 0
        c = self.counts
        self.counts = MocapCounts(c.received + 1, c.lost + skipped, c.late, c.malformed, c.doubted)
        self._latest, self._unseen = frame, True
        self._wake()

    def on_malformed(self, error: Exception) -> None:
        """Count an unreadable packet and drop the next frames; log the first one."""
        if self.counts.malformed == 0:
            LOG.warning("%s sent %s: such packets are dropped, and counted", self._where, error)
        self.counts = replace(self.counts, malformed=self.counts.malformed + 1)
        self._doubt = min(self._doubt + _DOUBT, _MOST_DOUBT)

    def fail(self, sentence: str) -> None:
        """Let every `wait_frame` from now on raise MocapError; the first reason stays."""
        if self._failure is None:
            self._failure = f"{self._where} {sentence}"
        self._wake()

    async def _woken(self, timeout_s: float) -> None:
        """Wait for a frame, a failure or the time-out; a bare future wakes sooner than asyncio.timeout and Event.

        There is one consumer, so one future is enough.
        """
        loop = asyncio.get_running_loop()
        self._waiter = loop.create_future()
        timer = loop.call_later(timeout_s, self._wake)
        try:
            await self._waiter
        finally:
            timer.cancel()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)
