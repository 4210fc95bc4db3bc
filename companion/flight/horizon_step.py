"""The horizon correction's part of a tick: what it may go by, and what is to be said of it. What fails ends no loop."""

import logging
import math
from collections.abc import Iterable

from companion.control.horizon_correction import HorizonInput
from companion.control.pipeline import changed
from companion.control.wire_setpoint import Wire, WireSetpoint
from companion.core.types import AttitudeThrust, AutopilotStatus
from companion.estimation.estimator import Estimate, Verdict, age_s
from companion.flight.setpoint_stream import SetpointStream
from companion.flight.tick_timer import control_step_s
from companion.supervisor.faults import Event, Fault
from companion.supervisor.flight_state import FlightState
from companion.supervisor.safety_rules import SafetyRules

LOG = logging.getLogger(__name__)

_DOUBTFUL = frozenset({
    Fault.MOCAP_JUMPED, Fault.MOCAP_FROZEN, Fault.MOCAP_INVALID, Fault.MOCAP_OUTLIERS, Fault.MOCAP_DELAYED,
    Fault.MOCAP_CLOCK_JUMP, Fault.LIFT_OFF_UNSEEN, Fault.ATTITUDE_DISAGREES, Fault.HORIZON_WRONG, Fault.HORIZON_LOST,
    Fault.HEADING_DISAGREES, Fault.AUTOPILOT_SILENT, Fault.AUTOPILOT_REBOOTED,
})  # fmt: skip
"""Neither attitude is known well enough to correct the other."""


class HorizonStep:
    """Corrects what leaves; `fault` says that the horizons are further apart than it corrects."""

    def __init__(
        self,
        wire: WireSetpoint,
        stream: SetpointStream,
        safety: SafetyRules,
        cap_rad: float,
        attitude_delay_s: float,
        period_s: float,
    ) -> None:
        self._wire, self._stream, self._delay_s, self._period_s = wire, stream, attitude_delay_s, period_s
        self._cap_rad, self._capped_limit_s = cap_rad, safety.horizon_capped_s
        self._last_s, self._capped_s = -math.inf, 0.0
        self._failed = False
        self.fault = ""
        """Empty when nothing is wrong."""

    def reset(self) -> None:
        """A stream of setpoints begins."""
        self._wire.reset()
        self._last_s, self._capped_s, self._failed, self.fault = -math.inf, 0.0, False, ""

    def correct(
        self,
        setpoint: AttitudeThrust,
        estimate: Estimate,
        status: AutopilotStatus,
        events: Iterable[Event],
        flight: FlightState,
        now_s: float,
    ) -> Wire | None:
        """Return what leaves instead of the law's setpoint; None: that itself, as there is nothing to correct it by."""
        vehicle = estimate.vehicle
        if vehicle is None or self._failed:
            return None
        trusted = estimate.verdict is not Verdict.STARTED and not any(event.fault in _DOUBTFUL for event in events)
        seen = HorizonInput(
            q_w_flu_wxyz=vehicle.q_w_flu_wxyz,
            rate_flu_radps=vehicle.rate_flu_radps,
            age_s=age_s(estimate, now_s),
            autopilot_q_w_flu_wxyz=status.q_w_flu_wxyz,
            autopilot_age_s=now_s - status.attitude_s + self._delay_s,
            trusted=trusted,
            flying=flight.airborne,
        )
        dt_s = control_step_s(now_s - self._last_s, self._period_s)
        self._last_s = now_s
        try:
            is_new = bool(changed(setpoint, self._stream.law_sent))
            return self._wire.put(setpoint, is_new, self._stream.wire, seen, dt_s)
        except Exception:
            LOG.exception("the correction of the horizon failed: setpoints leave as the law wants them")
            self._failed = True
            return None

    def judge(self, wire: Wire | None) -> None:
        """Judge once the setpoint has left whether the horizons are further apart than is corrected."""
        if wire is None:
            return
        off_rad = wire.horizon.off_rad
        beyond = wire.inputs.flying and off_rad > self._cap_rad
        self._capped_s = self._capped_s + wire.dt_s if beyond else 0.0
        self.fault = ""
        if self._capped_s >= self._capped_limit_s:
            self.fault = (
                f"the autopilot's horizon is {math.degrees(off_rad):.1f} degrees off motion capture's for "
                f"{self._capped_s:.1f} s, and at most {math.degrees(self._cap_rad):.1f} are corrected: land, check the "
                "rigid body's axes in QTM, and calibrate the accelerometer and the level horizon in QGroundControl"
            )
