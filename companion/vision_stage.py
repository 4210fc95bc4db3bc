"""Motion capture's pose on its way to the autopilot's own estimator (external vision)."""

import math

from companion.estimation.estimator import EstimatorState, Verdict
from companion.ports import Autopilot

_USED = frozenset({Verdict.ACCEPTED, Verdict.STARTED})


class VisionStage:
    """Forwards a new pose every so often, after the setpoint, as long as it is trusted."""

    def __init__(self, autopilot: Autopilot, rate_hz: float, cycle_s: float) -> None:
        self._autopilot, self._half_cycle_s = autopilot, 0.5 * cycle_s
        self._period_s = 1.0 / rate_hz if rate_hz > 0.0 else math.inf
        self._due_s = 0.0
        self.trusted = True
        """False: the autopilot, landing on its own, must not follow this pose either."""

    def forward(self, now_s: float, new_frame: bool, estimate: EstimatorState) -> None:
        """Send the estimate if it is of a new frame and due."""
        fresh = new_frame and estimate.verdict in _USED and self.trusted
        if estimate.vehicle is None or not fresh or now_s < self._due_s - self._half_cycle_s:
            return
        self._due_s = max(self._due_s, now_s - self._period_s) + self._period_s
        self._autopilot.send_vision(estimate.vehicle.position_w_m, estimate.vehicle.q_w_flu_wxyz)
