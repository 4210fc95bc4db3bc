"""Sinks that take every tick of the service, each independent of the others."""

import logging
import math
from collections.abc import Sequence

from companion.flight.tick import Tick, TickSink

LOG = logging.getLogger(__name__)


class LoopHeartbeat:
    """A TickSink: when the control loop ticked last. On its own, so that a mistake in telemetry ends no flight."""

    def __init__(self) -> None:
        self.ticked_s = math.inf
        """Infinite: it has still to begin."""

    def __call__(self, tick: Tick) -> None:
        """Take one tick."""
        self.ticked_s = tick.time_s


class FanOutSink:
    """Every tick to each of several; one that fails is not told any more, and the others are."""

    def __init__(self, sinks: Sequence[TickSink]) -> None:
        self._sinks = list(sinks)

    def __call__(self, tick: Tick) -> None:
        """Take one tick."""
        for sink in list(self._sinks):
            try:
                sink(tick)
            except Exception:
                LOG.exception("%s failed and is dropped", type(sink).__name__)
                self._sinks.remove(sink)
