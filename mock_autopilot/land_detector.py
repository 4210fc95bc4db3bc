"""When PX4 believes to be on the ground: low throttle and no vertical motion for long enough."""

from mock_autopilot.params import ParamTable

STAGES = 2.7
"""Ground contact, maybe landed, landed: recorded 2.7 s from low throttle to the text, at LNDMC_TRIG_TIME 1 s."""
DISARMED_LANDS_AFTER_S = 0.5
"""Recorded from PX4 v1.17: landed_state 1 half a second after a kill in the air."""


class LandDetector:
    """Takes off at once and lands with patience; looks at controls and estimated motion only, as PX4 does."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self.landed = True
        self._candidate_since_s: float | None = None

    def step(self, now_s: float, armed: bool, climb_controlled: bool, signal: float, down_mps: float) -> None:
        """Look once: `signal` is the collective 0..1, `climb_controlled` whether PX4 itself holds the height.

        `down_mps` is the estimator's: a vehicle that stands and believes to sink is not landed to PX4.
        """
        if armed and not self._throttle_low(climb_controlled, signal):
            self.landed = False
            self._candidate_since_s = None
            return
        still = abs(down_mps) < self._params["LNDMC_Z_VEL_MAX"] or not armed
        if self.landed or not still:
            self._candidate_since_s = None
            return
        if self._candidate_since_s is None:
            self._candidate_since_s = now_s
        wait_s = STAGES * self._params["LNDMC_TRIG_TIME"] if armed else DISARMED_LANDS_AFTER_S
        self.landed = now_s - self._candidate_since_s >= wait_s - 1e-9

    def _throttle_low(self, climb_controlled: bool, signal: float) -> bool:
        """In attitude control only idle counts; in height control clearly less than hover does.

        PX4's low throttle lies 30 % of the way from the least to the hover throttle. On the ground the recorded
        take-off was noticed a little earlier in its thrust ramp than that.
        """
        least, hover = self._params["MPC_THR_MIN"], self._params["MPC_THR_HOVER"]
        low = 0.3 * hover if self.landed else least + 0.3 * (hover - least)
        limit = low if climb_controlled else self._params["MPC_MANTHR_MIN"]
        return not signal >= limit  # so that NaN is low
