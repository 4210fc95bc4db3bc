"""Windows of time in which everything is lost; pure."""

import math
from random import Random

_MOST_CYCLES = 10_000
"""After a longer silence the windows begin anew: what nobody has seen need not be counted."""


class Bursts:
    """Windows of a fixed length, with gaps of random length (exponential) so that their share of the time is `share`.

    Ask with times that do not go back.
    """

    def __init__(self, share: float, length_s: float, rng: Random) -> None:
        self._share, self._length_s, self._rng = share, length_s, rng
        self._begin_s, self._end_s = math.nan, math.nan

    def covers(self, now_s: float) -> bool:
        """Return whether `now_s` is in a window."""
        if self._share <= 0.0 or self._share >= 1.0:
            return self._share >= 1.0
        if not now_s - self._end_s <= _MOST_CYCLES * self._length_s / self._share:
            self._begin(now_s)
        while self._end_s <= now_s:
            self._begin_s = self._end_s + self._gap_s()
            self._end_s = self._begin_s + self._length_s
        return self._begin_s <= now_s

    def _begin(self, now_s: float) -> None:
        """Begin anywhere in the cycle, so that the share is right from the first moment on."""
        inside = self._rng.random() < self._share
        self._begin_s = now_s - self._rng.random() * self._length_s if inside else now_s + self._gap_s()
        self._end_s = self._begin_s + self._length_s

    def _gap_s(self) -> float:
        return self._rng.expovariate(self._share / (self._length_s * (1.0 - self._share)))
