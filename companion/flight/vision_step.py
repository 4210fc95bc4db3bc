"""Motion capture's pose on its way to the autopilot's own estimator (external vision)."""

import logging
import math
from collections.abc import Iterable

from companion.core.interfaces import Autopilot
from companion.estimation.estimator import EstimatorState, Verdict
from companion.supervisor.faults import Event, Fault

LOG = logging.getLogger(__name__)

_USED = frozenset({Verdict.ACCEPTED, Verdict.STARTED})
_UNTRUSTED = frozenset({
    Fault.MOCAP_JUMPED, Fault.MOCAP_FROZEN, Fault.MOCAP_INVALID, Fault.MOCAP_OUTLIERS, Fault.MOCAP_DELAYED,
    Fault.MOCAP_CLOCK_JUMP, Fault.LIFT_OFF_UNSEEN, Fault.ATTITUDE_DISAGREES, Fault.HEADING_DISAGREES,
})  # fmt: skip
"""Poses that the autopilot, landing on its own, must not follow either."""


class VisionStep:
    """Forwards a new pose every so often, after the setpoint, as long as it is trusted. A failing link raises not."""

    def __init__(self, autopilot: Autopilot, rate_hz: float, cycle_s: float) -> None:
        self._autopilot, self._half_cycle_s = autopilot, 0.5 * cycle_s
        self._period_s = 1.0 / rate_hz if rate_hz > 0.0 else math.inf
        self._due_s = 0.0
        self._unsent = False
        self.trusted = True
        """False: the autopilot, landing on its own, must not follow this pose either."""

    def judge(self, events: Iterable[Event], armed: bool, cause: Fault | None = None) -> None:
        """Send no pose any more, as long as the vehicle is armed, once one was not to be trusted.

        `cause` is what the flight was handed over for.
        """
        if not armed:
            self.trusted = True
        elif cause in _UNTRUSTED or any(event.fault in _UNTRUSTED for event in events):
            self.trusted = False

    def forward(self, now_s: float, new_frame: bool, estimate: EstimatorState) -> None:
        """Send the estimate if it is of a new frame and due."""
        fresh = new_frame and estimate.verdict in _USED and self.trusted
        if estimate.vehicle is None or not fresh or now_s < self._due_s - self._half_cycle_s:
            return
        self._due_s = max(self._due_s, now_s - self._period_s) + self._period_s
        try:
            self._autopilot.send_vision(estimate.vehicle.position_w_m, estimate.vehicle.q_w_flu_wxyz)
        except Exception as error:
            if not self._unsent:
                LOG.error("a pose was not sent to the autopilot: %s", error)  # noqa: TRY400 - at the frames' rate
            self._unsent = True
        else:
            self._unsent = False
