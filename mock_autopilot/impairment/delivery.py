"""Delivery of what an impaired direction lets through, in the event loop's time."""

import asyncio
import math
import time
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from mock_autopilot.impairment.model import Impairment

Item = TypeVar("Item")


class Arrivals(Protocol[Item]):
    """An impaired direction, of datagrams or of a stream, that knows when its next item arrives."""

    def set(self, impairment: Impairment) -> None:
        """Change the impairment."""

    def due(self, now_s: float) -> list[Item]:
        """Return what has arrived by `now_s`."""

    @property
    def next_s(self) -> float:
        """Return the time of the next arrival, infinite if there is none."""


class TimedDelivery(Generic[Item]):
    """Calls `deliver` for each item of an impaired direction when it arrives, exact to the loop's timers (1 ms).

    Time is counted from `begin_s` of time.monotonic().
    """

    def __init__(self, direction: Arrivals[Item], deliver: Callable[[Item], None], begin_s: float) -> None:
        self._direction, self._deliver, self._begin_s = direction, deliver, begin_s
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_s = math.inf

    @property
    def now_s(self) -> float:
        """Return the time at which to `put` what is sent now."""
        return time.monotonic() - self._begin_s

    def set(self, impairment: Impairment) -> None:
        """Change the impairment."""
        self._direction.set(impairment)
        self.look()

    def look(self) -> None:
        """Deliver what has arrived, and come back for the next; call it after each `put`."""
        now_s = self.now_s
        for item in self._direction.due(now_s):
            self._deliver(item)
        next_s = self._direction.next_s
        if self._timer is not None and next_s == self._timer_s:
            return
        self.close()
        if next_s < math.inf:
            self._timer_s = next_s
            self._timer = self._loop.call_later(max(next_s - now_s, 0.0), self._wake)

    def close(self) -> None:
        """Deliver nothing more."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer, self._timer_s = None, math.inf

    def _wake(self) -> None:
        self._timer = None
        self.look()
