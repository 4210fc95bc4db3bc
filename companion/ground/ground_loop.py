"""Loop of the law on the ground: a cycle for each frame, or at a deadline, and what is due to the vehicle."""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from companion.core.interfaces import Clock, MocapSource
from companion.core.types import MocapFrame
from companion.flight.cycle_start import frame_or_deadline
from companion.flight.tick_timer import TickTimer, control_step_s
from companion.ground.ground_law import GroundLaw
from companion.ground.ground_tick import GroundTick
from companion.law_link.ground_end import GroundEnd

LOG = logging.getLogger(__name__)


class VehicleSocket(Protocol):
    """Socket to the vehicle."""

    @property
    def end(self) -> GroundEnd:
        """Ground's end of the link."""

    def send_due(self) -> None:
        """Send what is due now."""


Observer = Callable[[GroundTick], None]


def show(observers: list[Observer], tick: GroundTick) -> None:
    """Show a cycle to the observers; one that raises is dropped, and the law flies on."""
    for observe in list(observers):
        try:
            observe(tick)
        except Exception:
            LOG.exception("an observer of the law failed and is dropped")
            observers.remove(observe)


class GroundLoop:
    """Runs the law until cancelled; the observers get each cycle, after its command has left."""

    def __init__(self, mocap: MocapSource, link: VehicleSocket, law: GroundLaw, clock: Clock, period_s: float) -> None:
        self._mocap, self._link, self._law, self._clock, self._period_s = mocap, link, law, clock, period_s
        self._frame: MocapFrame | None = None
        self._last_s = clock.now_s()
        self.observers: list[Observer] = []

    async def run(self) -> None:
        """Cycle until cancelled; raises MocapError when the connection to motion capture is lost."""
        timer = TickTimer(self._period_s, self._clock.now_s() + self._period_s)
        while True:
            frame_s = await frame_or_deadline(self._mocap, self._clock, timer)
            if frame_s is None:
                await asyncio.sleep(0)
            now_s = self._clock.now_s()
            self.cycle(now_s, timer.begin(now_s, frame_s))

    def cycle(self, now_s: float, late_s: float = 0.0) -> None:
        """Run one cycle: frame, law, message; then what the law left for after it, and the observers."""
        frame = self._mocap.latest()
        if frame is None or frame.is_same(self._frame):
            frame = None
        else:
            self._frame = frame
            self._law.take(frame)
        tick = self._law.tick(now_s, control_step_s(now_s - self._last_s, self._period_s))
        self._last_s = now_s
        self._link.send_due()
        late_signals = self._law.settle()
        if self.observers:
            show(self.observers, replace(tick, late_s=late_s, frame=frame, late_signals=late_signals))
