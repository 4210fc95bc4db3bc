"""Record of one cycle of the flight loop, for observers."""

import math
from dataclasses import dataclass
from typing import Any, Protocol

from companion.control.pipeline import PipelineOutput
from companion.control.wire_setpoint import Wire
from companion.core.types import Array, AutopilotStatus, GroundPose, MocapFrame, Reference, VehicleState
from companion.estimation.state import EstimatorState
from companion.flight.arm_step import ArmTick
from companion.flight.remote_step import LinkTick
from companion.guard.limits import LimitedSetpoint
from companion.supervisor.faults import Event, Stage
from companion.supervisor.flight_state import FlightState


@dataclass(frozen=True)
class MoreColumns:
    """Further columns for the record of a cycle."""

    names: dict[str, tuple[str, str]]
    """Names of the numbers and of the arrays of each topic; the same object in every cycle."""
    numbers: tuple[Any, ...]
    arrays: tuple[Array, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Tick:
    """Inputs, decisions and outputs of one cycle, for recording and for observers."""

    time_s: float
    late_s: float
    frame_received_s: float
    """Arrival of the frame this cycle was the first to use; NaN when it had no new one."""
    sent_s: float
    """When its setpoint had left; NaN when none was sent."""
    vehicle: VehicleState | None
    age_s: float
    status: AutopilotStatus
    flight: FlightState
    reference: Reference | None
    """Reference at this tick."""
    pipeline: PipelineOutput | None
    limited: LimitedSetpoint | None
    late_signals: dict[str, Array]
    """Inner values of the law that it worked out after the setpoint had left."""
    arms: ArmTick | None
    events: tuple[Event, ...]
    """Faults that were present."""
    frame: MocapFrame | None = None
    """The frame this cycle was the first to use."""
    ground_pose: GroundPose | None = None
    """The ground law's pose that this cycle was the first to use, on a vehicle that frames do not reach."""
    estimate: EstimatorState | None = None
    """All that the estimator knows after it."""
    law: str = ""
    """Name of the control law."""
    wire: Wire | None = None
    """Setpoint that was sent, with the correction of the autopilot's horizon."""
    link: LinkTick | None = None
    """Link to a law on the ground; None for a law on board."""
    more: tuple[MoreColumns, ...] = ()
    stage: Stage = Stage.GROUND
    """In which `events` were found, before they led anywhere; the table of reactions goes by it."""

    @property
    def pose_age_s(self) -> float:
        """Age of the newest pose: the ground's where frames do not reach the vehicle, else that of the state."""
        estimate = self.estimate
        if estimate is None or estimate.motion is not None or not math.isfinite(estimate.stamp_s):
            return self.age_s
        return self.time_s - estimate.stamp_s


class TickSink(Protocol):
    """Whoever wants every tick: the recorder, a display. Must neither block nor raise."""

    def __call__(self, tick: Tick) -> None:
        """Take one tick."""
