"""Values that become known a whole number of steps after they were true."""

import numpy as np
from numpy.typing import NDArray

from companion.types import Array


class DelayLine:
    """Arrays of one vehicle, or of a batch in which each may have its own delay; filled with the first value."""

    def __init__(self, delay_steps: NDArray[np.int64], first: Array) -> None:
        self._delay = delay_steps
        self._each = np.arange(self._delay.size).reshape(self._delay.shape) if self._delay.ndim else None
        self._size = int(self._delay.max()) + 1
        self._ring = [first] * self._size if self._each is None else np.repeat(first[None], self._size, axis=0)
        self._now = 0

    def put(self, value: Array) -> Array:
        """Enter what is true now, a step after the last; what is known now."""
        self._now = (self._now + 1) % self._size
        self._ring[self._now] = value
        if self._each is None:
            return np.asarray(self._ring[(self._now - int(self._delay)) % self._size])
        return np.asarray(self._ring[(self._now - self._delay) % self._size, self._each])  # type: ignore[call-overload]
