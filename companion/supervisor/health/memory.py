"""Memory values of the health checks: begin of a condition, and numbers within a time window."""

from bisect import bisect_right
from math import inf

from companion.core.values import value

NOT_HELD = inf
"""Begin of a condition that does not hold: its duration is below every limit."""


def held_since(before_s: float, holds: bool, now_s: float) -> float:
    """Return the begin of the unbroken time in which a condition held, s; NOT_HELD when it does not hold now."""
    if not holds:
        return NOT_HELD
    return before_s if before_s < now_s else now_s


@value
class Window:
    """Numbers within a time window, each with its time (s), oldest first."""

    times_s: tuple[float, ...] = ()
    numbers: tuple[float, ...] = ()

    def kept(self, after_s: float) -> "Window":
        """Return the window without the numbers of `after_s` or earlier."""
        old = bisect_right(self.times_s, after_s)
        return Window(self.times_s[old:], self.numbers[old:]) if old else self

    def added(self, time_s: float, number: float) -> "Window":
        """Return the window with one more number."""
        return Window((*self.times_s, time_s), (*self.numbers, number))

    @property
    def total(self) -> float:
        """Sum of the numbers in the window."""
        return sum(self.numbers)
