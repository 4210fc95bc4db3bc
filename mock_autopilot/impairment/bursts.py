"""Windows of time in which everything is lost; pure."""

import math
from random import Random


class Bursts:
    """Windows of a fixed length whose share of the time is `share`: one, at random, in each cell of `length / share`.

    They depend on the seed and the time alone, so directions with the same seed are cut at the same times.
    """

    def __init__(self, share: float = 0.0, length_s: float = 0.0, seed: int = 1) -> None:
        self._share, self._length_s, self._seed = share, length_s, seed
        self._cell_s = length_s / share if share else math.inf
        self._cell, self._begin_s = -1, math.inf

    def covers(self, now_s: float) -> bool:
        """Return whether `now_s` (s) is in a window."""
        if not 0.0 < self._share < 1.0:
            return self._share >= 1.0
        cell = math.floor(now_s / self._cell_s)
        if cell != self._cell:
            offset = Random(f"{self._seed} {cell}").random()
            self._cell, self._begin_s = cell, cell * self._cell_s + offset * (self._cell_s - self._length_s)
        return self._begin_s <= now_s < self._begin_s + self._length_s
