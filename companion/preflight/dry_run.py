"""The law in front of the real room: it works out what would be sent, and there is nothing to send it with."""

import logging
import math

import numpy as np

from companion.config.companion_config import CompanionConfig
from companion.control.controller import Controller
from companion.control.pipeline import PipelineOutput, idle_setpoint
from companion.core.types import Reference, VehicleState
from companion.flight.arm_step import ArmTick
from companion.flight.assembly import health_of, period_s, pipeline_of
from companion.flight.health_step import Cycle, Sides
from companion.flight.tick import Tick, TickSink
from companion.flight.tick_timer import control_step_s
from companion.geometry.frames import up_axis, yaw_of
from companion.preflight.checks.dry_run_report import DryRunFacts
from companion.preflight.service_facts import Running
from companion.supervisor.faults import Fault
from companion.supervisor.flight_state import FlightState
from companion.trajectories.reference import Hold, Trajectory

LOG = logging.getLogger(__name__)


class DryRun:
    """Call it once a cycle. It holds where the vehicle stood first, or flies a trajectory in its mind."""

    def __init__(
        self, running: Running, config: CompanionConfig, law: Controller, trajectory: Trajectory | None, sink: TickSink
    ) -> None:
        self._running, self._trajectory, self._sink = running, trajectory, sink
        self._pipeline, self._period_s = pipeline_of(config, law), period_s(config)
        self._sent = idle_setpoint(0.0)
        """Take each setpoint as if it were sent."""
        self._health = health_of(config, Sides(disk_free_mb=running.disk_free_mb))
        self._begun_s = math.nan
        self._last_s = -math.inf
        self._fault = ""
        self._cycles = self._not_finite = 0
        self._most_tilt_rad, self._thrust = 0.0, (math.inf, -math.inf)
        self._events: dict[Fault, str] = {}

    def __call__(self, now_s: float, frame_received_s: float) -> None:
        """Run one cycle, at most as often as in flight."""
        if now_s - self._last_s < 0.75 * self._period_s:
            return
        dt_s = control_step_s(now_s - self._last_s, self._period_s)
        self._last_s = now_s
        estimate, status = self._running.estimate(), self._running.autopilot.status()
        vehicle = estimate.vehicle
        age_s = math.inf if vehicle is None else now_s - vehicle.time_s
        output = None if vehicle is None or self._fault else self._fly(vehicle, now_s, age_s, dt_s)
        arms, frame = self._running.arms, self._running.mocap.latest()
        arm_fault = arms.fault if arms is not None else ""
        streaming = output is not None  # in its mind: the checks say nothing of motion capture before
        cycle = Cycle(
            time_s=now_s,
            late_s=0.0,
            frame=frame,
            estimate=estimate,
            status=status,
            streaming=streaming,
            sent=self._sent,
            at_max_thrust=False,
            law_fault=self._fault,
            arm_fault=arm_fault,
        )
        events = self._health.look(cycle, FlightState())
        for event in events:
            self._events.setdefault(event.fault, event.text)
        arm_tick = ArmTick(arms.state.phase, "", None, arms.status, np.zeros(3)) if arms is not None else None
        self._sink(
            Tick(
                time_s=now_s,
                late_s=0.0,
                frame_received_s=frame_received_s,
                sent_s=math.nan,
                vehicle=vehicle,
                age_s=age_s,
                status=status,
                flight=FlightState(),
                reference=self._reference(now_s) if output is not None else None,
                pipeline=output,
                limited=output.limited if output is not None else None,
                late_signals={} if self._fault else self._pipeline.settle(),
                arms=arm_tick,
                events=events,
            )
        )

    @property
    def seen(self) -> DryRunFacts:
        """All of it so far."""
        return DryRunFacts(
            self._cycles, self._not_finite, self._fault, self._most_tilt_rad, self._thrust, dict(self._events)
        )

    def _fly(self, vehicle: VehicleState, now_s: float, age_s: float, dt_s: float) -> PipelineOutput | None:
        if self._trajectory is None:
            self._trajectory = Hold(vehicle.position_w_m, float(yaw_of(vehicle.q_w_flu_wxyz)))
        if math.isnan(self._begun_s):
            self._begun_s = now_s
        try:
            output = self._pipeline.fly(
                vehicle, age_s, self._reference(now_s + self._pipeline.preview_s), self._sent, dt_s
            )
        except Exception as error:
            LOG.exception("the control law failed")
            self._fault = f"the control law failed: {type(error).__name__}: {error}"
            return None
        self._sent = setpoint = output.limited.setpoint
        self._fault = output.limited.failure
        thrust = float(setpoint.thrust)
        self._cycles += 1
        self._not_finite += bool(output.limited.not_finite)
        self._most_tilt_rad = max(self._most_tilt_rad, math.acos(min(1.0, float(up_axis(setpoint.q_w_flu_wxyz)[2]))))
        self._thrust = min(self._thrust[0], thrust), max(self._thrust[1], thrust)
        return output

    def _reference(self, time_s: float) -> Reference:
        assert self._trajectory is not None
        return self._trajectory.at(time_s - self._begun_s)
