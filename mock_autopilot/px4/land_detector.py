"""PX4's land detector: low throttle and no vertical motion for long enough."""

from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.timing import Timing

DISARMED_LANDS_AFTER_S = 0.5
"""Recorded from PX4 v1.17: landed_state 1 half a second after a kill in the air."""
LOW_SHARE, LOW_SHARE_KNOWN = 0.3, 0.6
"""Low throttle lies so far from the least to the hover throttle; farther once the hover throttle is estimated, which
PX4 does where it controls the height itself."""

MAYBE_LANDED = 2.5
"""Factor on LNDMC_Z_VEL_MAX from the second stage on."""


class LandDetector:
    """The land detector; it detects take-off at once and landing after a delay, from controls and estimated motion.

    PX4 goes through three stages (ground contact, maybe landed, landed), LNDMC_TRIG_TIME / 3 each, and starts again
    when the noise of its gyros or of its estimate looks like motion: how long that takes is drawn as recorded.
    """

    def __init__(self, params: ParamTable, timing: Timing) -> None:
        self._params, self._timing = params, timing
        self.landed = True
        self._candidate_since_s: float | None = None
        self._wait_s = 0.0

    def step(
        self, now_s: float, armed: bool, climb_controlled: bool, signal: float, down_mps: float, has_gps: bool = False
    ) -> None:
        """Update `landed`: `signal` is the collective 0..1; `climb_controlled` while PX4 itself holds the height.

        `down_mps` is the estimator's: a standing vehicle whose estimate sinks is not landed to PX4.
        """
        if armed and not self._throttle_low(climb_controlled, signal):
            self.landed = False
            self._candidate_since_s = None
            return
        still = abs(down_mps) < self._params["LNDMC_Z_VEL_MAX"] * self._patience(now_s) or not armed
        if self.landed or not still:
            self._candidate_since_s = None
            return
        if self._candidate_since_s is None:
            self._candidate_since_s = now_s
            stages = self._timing.land_stages(climb_controlled, has_gps)
            self._wait_s = stages * self._params["LNDMC_TRIG_TIME"] if armed else DISARMED_LANDS_AFTER_S
        self.landed = now_s - self._candidate_since_s >= self._wait_s - 1e-9

    def _patience(self, now_s: float) -> float:
        """Return the factor on the speed limit: wider once it may have landed, where the estimate errs most."""
        since_s = self._candidate_since_s
        return MAYBE_LANDED if since_s is not None and now_s - since_s >= self._wait_s / 2.0 else 1.0

    def _throttle_low(self, climb_controlled: bool, signal: float) -> bool:
        """Return whether the throttle is low: idle in attitude control, clearly below hover in height control.

        On the ground the recorded take-off was noticed a little earlier in its thrust ramp than that.
        """
        least, hover = self._params["MPC_THR_MIN"], self._params["MPC_THR_HOVER"]
        low = LOW_SHARE * hover if self.landed else least + LOW_SHARE_KNOWN * (hover - least)
        limit = low if climb_controlled else self._params["MPC_MANTHR_MIN"] + 0.01
        return not signal >= limit  # so that NaN is low
