"""Motion capture before a flight: is the body seen, often, early and exactly enough?"""

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from companion.core.interfaces import MocapSource
from companion.core.types import MocapFrame
from companion.estimation.clock_sync import to_local_s
from companion.estimation.estimator import EstimatorState
from companion.preflight.checks.check import Check

_SEEN = 0.98
"""Share of frames in which the body must be tracked."""


_MOST = 100_000
"""Samples that are kept: a quarter of an hour at 100 Hz, for a watch that is left running."""
_OFTEN = 0.95


@dataclass(frozen=True, kw_only=True)
class MocapFacts:
    """Statistics of some seconds of motion capture."""

    body: str
    frames: int
    seconds_s: float
    tracked: int
    age_s: float
    """Age of the newest pose that 95 % of the moments looked at stayed below; infinite without a pose."""
    delay_s: float
    """Median from capture to arrival, as far as the clocks tell; NaN without a pose."""
    residual_m: float
    """Median marker residual; NaN when it is not reported."""
    why_silent: str = ""
    """Why no frames came, if none did and that is known."""

    @property
    def rate_hz(self) -> float:
        """Rate of arrived frames, Hz."""
        return self.frames / self.seconds_s if self.seconds_s > 0.0 else 0.0


def check_body(seen: MocapFacts) -> Check:
    """Check that the rigid body is tracked all the time."""
    share = seen.tracked / seen.frames if seen.frames else 0.0
    todo = (
        f"is {seen.body!r} in the volume, are its markers uncovered and the cameras calibrated?"
        if seen.frames
        else seen.why_silent or "no frame came: is QTM measuring, and its real-time output on?"
    )
    return Check("body seen", share >= _SEEN, f"{seen.body!r} in {share:.0%} of {seen.frames} frames", todo)


def check_rate(seen: MocapFacts, least_hz: float) -> Check:
    """Check the rate of frames."""
    says = f"{seen.rate_hz:.0f} Hz, at least {least_hz:g} wanted"
    todo = "raise the capture rate in QTM, or look for losses on the network: a cable, not Wi-Fi"
    return Check("mocap rate", seen.rate_hz >= least_hz, says, todo)


def check_age(seen: MocapFacts, most_s: float) -> Check:
    """Check the age of poses against the limit for flight."""
    known = math.isfinite(seen.age_s)
    says = f"below {1e3 * seen.age_s:.0f} ms for 95 % of the time" if known else "no pose at all"
    todo = "frames are late or come in bursts: look at the network, at QTM's processing and at this computer's load"
    return Check("mocap age", seen.age_s <= most_s, f"{says}, at most {1e3 * most_s:.0f} wanted", todo)


def check_residual(seen: MocapFacts, most_m: float) -> Check:
    """Check the residual of the markers; passes when the system does not report it."""
    if math.isnan(seen.residual_m):
        return Check("mocap residual", True, "not reported")
    says = f"{1e3 * seen.residual_m:.1f} mm, at most {1e3 * most_m:.1f} wanted"
    todo = "define the body again in QTM (a marker has moved), or calibrate the cameras"
    return Check("mocap residual", seen.residual_m <= most_m, says, todo)


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

    def seen(self, body: str, seconds_s: float) -> MocapFacts:
        """Return what was gathered in `seconds_s` of looking."""
        ages_s = sorted(self._ages_s)
        return MocapFacts(
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
