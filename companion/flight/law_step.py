"""The law's part of a tick: its setpoint, and what is to be said of the law. What fails in it ends no loop."""

import logging
import math

from companion.control.pipeline import ControlPipeline, PipelineOutput
from companion.core.types import Array, AttitudeThrust
from companion.estimation.estimator import Estimate, age_s
from companion.flight.arm_step import ArmStep
from companion.flight.tick_timer import control_step_s
from companion.guard.limits import LimitedSetpoint
from companion.supervisor import state_machine
from companion.supervisor.flight_state import STREAMING, FlightRules, FlightState
from companion.supervisor.safety_rules import SafetyRules

LOG = logging.getLogger(__name__)

_PUSHED_S = 0.5
"""Time for which a vehicle still moves away after the guard has pushed it."""


class LawStep:
    """Calls the law while the vehicle flies; on the ground the law sleeps."""

    def __init__(
        self,
        pipeline: ControlPipeline,
        arms: ArmStep | None,
        rules: FlightRules,
        safety: SafetyRules,
        max_thrust: float,
        period_s: float,
    ) -> None:
        self._pipeline, self._arms, self._rules = pipeline, arms, rules
        self._not_finite_limit, self._max_thrust, self._period_s = safety.not_finite_cycles, max_thrust, period_s
        self._last_s = -math.inf
        self._not_finite = 0
        self.fault = ""
        """Why the law is no longer to be trusted; empty when it is."""
        self.at_max_thrust = False
        """The last cycle's thrust was cut at its upper limit."""
        self._pushed_s = -math.inf
        self.pushed = False
        """The guard has kept a setpoint away from another vehicle a moment ago: it may still move away."""
        self.pushed_now = False
        """It has done so in the last cycle."""

    def trust(self) -> None:
        """A flight begins."""
        self.fault, self._not_finite = "", 0

    def control(
        self, flight: FlightState, estimate: Estimate, sent: AttitudeThrust, now_s: float
    ) -> tuple[PipelineOutput | None, LimitedSetpoint | None]:
        """Return this cycle's setpoint, limited; None in phases that send nothing, and where the law raises.

        `sent` is the law's setpoint that was sent last.
        """
        try:
            output, limited = self._control(flight, estimate, sent, now_s)
        except Exception as error:
            self._lose(error)
            return None, None
        if limited is not None and limited.failure:
            self.fault = f"the guard failed: {limited.failure}"
        bad = limited is not None and bool(limited.not_finite)
        self._not_finite = self._not_finite + 1 if bad else 0
        if self._not_finite > self._not_finite_limit:
            self.fault = f"the control law gave no finite command for {self._not_finite_limit} cycles"
        self.pushed_now = output is not None and bool(output.limited.separation_cut)
        if self.pushed_now:
            self._pushed_s = now_s
        self.pushed = now_s - self._pushed_s <= _PUSHED_S
        self.at_max_thrust = output is not None and float(output.limited.setpoint.thrust) >= self._max_thrust
        return output, limited

    def settle(self) -> dict[str, Array]:
        """Do what the law left for after the setpoint, and return its late inner values; empty if it raises."""
        try:
            return self._pipeline.settle()
        except Exception as error:
            self._lose(error)
            return {}

    def _lose(self, error: Exception) -> None:
        LOG.exception("the control law failed")
        self.fault = f"the control law failed: {type(error).__name__}: {error}"

    def _control(
        self, flight: FlightState, estimate: Estimate, sent: AttitudeThrust, now_s: float
    ) -> tuple[PipelineOutput | None, LimitedSetpoint | None]:
        dt_s = control_step_s(now_s - self._last_s, self._period_s)
        self._last_s = now_s
        vehicle = estimate.vehicle
        if vehicle is None or flight.phase not in STREAMING:
            return None, None
        if not flight.airborne:
            thrust = state_machine.ground_thrust(flight, now_s, self._rules)
            return None, self._pipeline.on_ground(flight.yaw_rad, thrust, sent, dt_s)
        ahead = state_machine.reference_at(flight, now_s + self._pipeline.preview_s)
        if self._arms is None:
            output = self._pipeline.fly(vehicle, age_s(estimate, now_s), ahead, sent, dt_s)
        else:
            known_w_mps2 = self._arms.known_accel_w_mps2(vehicle.q_w_flu_wxyz)
            output = self._pipeline.fly(vehicle, age_s(estimate, now_s), ahead, sent, dt_s, known_w_mps2)
        return output, output.limited
