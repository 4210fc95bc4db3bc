"""Record of one cycle of the law on the ground, for observers."""

from dataclasses import dataclass, field
from math import nan

from companion.control.pipeline import PipelineOutput
from companion.core.types import Array, AttitudeThrust, MocapFrame, Reference, VehicleState
from companion.estimation.estimator import EstimatorState
from companion.law_link.ground_session import GroundLinkState
from companion.law_link.messages import Command, UpFlags


@dataclass(frozen=True, kw_only=True)
class FlownCycle:
    """Inputs and outputs of the law in one cycle on the ground."""

    output: PipelineOutput
    sent: Command | None
    """Command that this cycle has sent; None without an event."""
    mirror: AttitudeThrust
    """Setpoint that the vehicle is taken to have sent last."""
    reference: Reference
    """Reference now."""


@dataclass(frozen=True, kw_only=True)
class GroundTick:
    """Inputs and result of one cycle on the ground, for the record and for observers."""

    time_s: float
    vehicle_s: float
    """Time on the vehicle's clock at which a command sent now arrives; NaN without a session."""
    estimate: EstimatorState
    age_s: float
    """Age of the estimated state now."""
    flown: FlownCycle | None
    """Inputs and outputs of the law; None while it does not fly."""
    flags: UpFlags
    law: str
    made_for_s: float
    """Age of the uplink that the law was made for."""
    failure: str
    """Reason for which the law is no longer trusted; empty while it is."""
    flying: bool
    """The vehicle reports that the law flies it."""
    epoch: int
    """Number of the flight."""
    link: GroundLinkState
    late_s: float = nan
    """Time by which the cycle began late; NaN without motion capture."""
    frame: MocapFrame | None = None
    """Frame that this cycle was the first to use."""
    late_signals: dict[str, Array] = field(default_factory=dict)
    """Internal values of the law that it computed after its command."""

    @property
    def vehicle(self) -> VehicleState | None:
        """Estimated state; None before the first frame."""
        return self.estimate.vehicle

    @property
    def output(self) -> PipelineOutput | None:
        """Output of the law; None while it does not fly."""
        return None if self.flown is None else self.flown.output
