"""Some seconds of motion capture, gathered for the preflight's checks."""

import math
from collections import deque
from collections.abc import Callable, Iterable

import numpy as np

from companion.core.interfaces import MocapSource
from companion.core.types import MocapFrame
from companion.estimation.clock_sync import to_local_s
from companion.estimation.estimator import EstimatorState
from companion.preflight.checks.mocap import MocapSeen

_MOST = 100_000
"""Samples that are kept: a quarter of an hour at 100 Hz, for a watch that is left running."""
_OFTEN = 0.95


class MocapWatch:
    """Frames of one source and their age; call `look` every few milliseconds."""

    def __init__(self, mocap: MocapSource, estimate: Callable[[], EstimatorState], delay_s: float) -> None:
        """`delay_s` is the configured least delay of motion capture."""
        self._mocap, self._estimate, self._delay_s = mocap, estimate, delay_s
        self._newest: MocapFrame | None = mocap.latest()
        self.frames = self.tracked = 0
        self._ages_s: deque[float] = deque(maxlen=_MOST)
        self._delays_s: deque[float] = deque(maxlen=_MOST)
        self._residuals_m: deque[float] = deque(maxlen=_MOST)

    def look(self, now_s: float) -> None:
        """Take what came since the last call."""
        frame, estimate = self._mocap.latest(), self._estimate()
        if frame is not None and frame is not self._newest:
            self._newest = frame
            self._take(frame, estimate)
        vehicle = estimate.vehicle
        self._ages_s.append(now_s - vehicle.time_s if vehicle is not None else math.inf)

    def _take(self, frame: MocapFrame, estimate: EstimatorState) -> None:
        self.frames += 1
        if frame.tracked:
            self.tracked += 1
            self._residuals_m.append(frame.residual_m)
        if estimate.vehicle is not None:
            self._delays_s.append(frame.received_s - to_local_s(estimate.clock, frame.stamp_s, self._delay_s))

    def seen(self, body: str, seconds_s: float) -> MocapSeen:
        """Return what was gathered in `seconds_s` of looking."""
        ages_s = sorted(self._ages_s)
        return MocapSeen(
            body=body,
            frames=self.frames,
            seconds_s=seconds_s,
            tracked=self.tracked,
            age_s=ages_s[int(_OFTEN * len(ages_s))] if ages_s else math.inf,
            delay_s=median(self._delays_s),
            residual_m=median(self._residuals_m),
            why_silent="" if self.frames else self._mocap.why_silent(),
        )


def median(values: Iterable[float]) -> float:
    """Return the median of the values that are known; NaN when none is."""
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else math.nan
