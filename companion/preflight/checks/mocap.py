"""Motion capture before a flight: is the body seen, often, early and exactly enough?"""

import math
from dataclasses import dataclass

from companion.preflight.checks.check import Check

_SEEN = 0.98
"""Share of frames in which the body must be tracked."""


@dataclass(frozen=True, kw_only=True)
class MocapSeen:
    """Statistics of some seconds of motion capture."""

    body: str
    frames: int
    """Frames that arrived."""
    seconds_s: float
    """In so much time."""
    tracked: int
    """Frames that held a pose."""
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


def check_body(seen: MocapSeen) -> Check:
    """Check that the rigid body is tracked all the time."""
    share = seen.tracked / seen.frames if seen.frames else 0.0
    todo = (
        f"is {seen.body!r} in the volume, are its markers uncovered and the cameras calibrated?"
        if seen.frames
        else seen.why_silent or "no frame came: is QTM measuring, and its real-time output on?"
    )
    return Check("body seen", share >= _SEEN, f"{seen.body!r} in {share:.0%} of {seen.frames} frames", todo)


def check_rate(seen: MocapSeen, least_hz: float) -> Check:
    """Check the rate of frames."""
    says = f"{seen.rate_hz:.0f} Hz, at least {least_hz:g} wanted"
    todo = "raise the capture rate in QTM, or look for losses on the network: a cable, not Wi-Fi"
    return Check("mocap rate", seen.rate_hz >= least_hz, says, todo)


def check_age(seen: MocapSeen, most_s: float) -> Check:
    """Check the age of poses against the limit for flight."""
    known = math.isfinite(seen.age_s)
    says = f"below {1e3 * seen.age_s:.0f} ms for 95 % of the time" if known else "no pose at all"
    todo = "frames are late or come in bursts: look at the network, at QTM's processing and at this computer's load"
    return Check("mocap age", seen.age_s <= most_s, f"{says}, at most {1e3 * most_s:.0f} wanted", todo)


def check_residual(seen: MocapSeen, most_m: float) -> Check:
    """Check the residual of the markers; passes when the system does not report it."""
    if math.isnan(seen.residual_m):
        return Check("mocap residual", True, "not reported")
    says = f"{1e3 * seen.residual_m:.1f} mm, at most {1e3 * most_m:.1f} wanted"
    todo = "define the body anew in QTM (a marker has moved), or calibrate the cameras"
    return Check("mocap residual", seen.residual_m <= most_m, says, todo)
