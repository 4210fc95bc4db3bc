"""What the health checks remember of the past: since when something holds, and how often it came in a stretch of time.

Plain values; a window costs one copy of a short tuple a cycle.
"""

from bisect import bisect_right
from math import inf

from companion.core.values import value

NEVER = inf
"""Since when what does not hold holds: so that the time it has lasted is below every limit."""


def since(before_s: float, holds: bool, now_s: float) -> float:
    """Begin of an unbroken time in which something held, s; NEVER when it does not hold now."""
    if not holds:
        return NEVER
    return before_s if before_s < now_s else now_s


@value
class Window:
    """Numbers of the last stretch of time, each with the time (s) at which it came, oldest first."""

    times_s: tuple[float, ...] = ()
    numbers: tuple[float, ...] = ()

    def kept(self, after_s: float) -> "Window":
        """Without what came at `after_s` or before."""
        old = bisect_right(self.times_s, after_s)
        return Window(self.times_s[old:], self.numbers[old:]) if old else self

    def added(self, time_s: float, number: float) -> "Window":
        """With one more."""
        return Window((*self.times_s, time_s), (*self.numbers, number))

    @property
    def total(self) -> float:
        """Sum of the numbers."""
        return sum(self.numbers)
