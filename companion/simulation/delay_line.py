"""Delay lines: values that become available a whole number of steps later."""

from collections import deque
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from companion.core.types import Array

Value = TypeVar("Value")


class DelayLine(Generic[Value]):
    """Delay line of one vehicle, or of a batch with one delay; filled with the first value."""

    def __init__(self, delay_steps: int, first: Value) -> None:
        self._line = deque([first] * delay_steps)

    def put(self, value: Value) -> Value:
        """Enter the present value, a step after the last; return the delayed one."""
        self._line.append(value)
        return self._line.popleft()


class EachDelayLine:
    """Delay line of a batch in which each vehicle has its own delay (...,); filled with the first value."""

    def __init__(self, delay_steps: NDArray[np.int64], first: Array) -> None:
        self._delay = delay_steps
        self._each = np.arange(self._delay.size).reshape(self._delay.shape)
        self._size = int(self._delay.max()) + 1
        self._ring = np.repeat(first[None], self._size, axis=0)
        self._now = 0

    def put(self, value: Array) -> Array:
        """Enter the present value, a step after the last; return the delayed one."""
        self._now = (self._now + 1) % self._size
        self._ring[self._now] = value
        return np.asarray(self._ring[(self._now - self._delay) % self._size, self._each])
