"""Loop of the law on the ground: a cycle for each frame, or at a deadline, and what is due to the vehicle."""

import asyncio
import logging
from collections.abc import Callable
from typing import Protocol

from companion.core.interfaces import Clock, MocapSource
from companion.core.types import MocapFrame
from companion.flight.tick_timer import TickTimer, control_step_s
from companion.ground.ground_law import GroundLaw, GroundTick
from companion.law_link.ground_end import GroundEnd

LOG = logging.getLogger(__name__)


class VehicleSocket(Protocol):
    """Socket to the vehicle."""

    @property
    def end(self) -> GroundEnd:
        """Ground's end of the link."""

    def send_due(self) -> None:
        """Send what is due now."""


class GroundLoop:
    """Runs the law until cancelled; `observe` gets each cycle, after its command has left."""

    def __init__(self, mocap: MocapSource, link: VehicleSocket, law: GroundLaw, clock: Clock, period_s: float) -> None:
        self._mocap, self._link, self._law, self._clock, self._period_s = mocap, link, law, clock, period_s
        self._frame: MocapFrame | None = None
        self._last_s = clock.now_s()
        self.observers: list[Callable[[GroundTick], None]] = []

    async def run(self) -> None:
        """Cycle until cancelled; raises MocapError when the connection to motion capture is lost."""
        timer = TickTimer(self._period_s, self._clock.now_s() + self._period_s)
        while True:
            frame_s = await self._next_start(timer)
            now_s = self._clock.now_s()
            timer.begin(now_s, frame_s)
            self.cycle(now_s)

    async def _next_start(self, timer: TickTimer) -> float | None:
        """Wait for the next cycle's frame or for the deadline; return the frame's arrival (s), or None."""
        while True:
            left_s = timer.deadline_s - self._clock.now_s()
            if left_s <= 0.0:
                await asyncio.sleep(0)
                return None
            if await self._mocap.wait_frame(left_s):
                frame = self._mocap.latest()
                if frame is not None and not timer.frame_is_early(frame.received_s):
                    return frame.received_s

    def cycle(self, now_s: float) -> None:
        """Run one cycle: frame, law, message; then what the law left for after it."""
        frame = self._mocap.latest()
        before = self._frame
        if frame is not None and (before is None or (frame.frame, frame.stamp_s) != (before.frame, before.stamp_s)):
            self._frame = frame
            self._law.take(frame)
        tick = self._law.tick(now_s, control_step_s(now_s - self._last_s, self._period_s))
        self._last_s = now_s
        self._link.send_due()
        self._law.settle()
        for observe in self.observers:
            observe(tick)
