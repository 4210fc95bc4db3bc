"""What the health checks look at: one cycle's measurements and states, as plain values."""

from companion.core.types import Array, AttitudeThrust, AutopilotStatus, VehicleState
from companion.core.values import value
from companion.estimation.state import Verdict
from companion.supervisor.faults import Stage


@value
class MocapInputs:
    """Motion capture in this cycle."""

    age_s: float
    """Since the capture of the newest usable frame; infinite before the first one."""
    verdict: Verdict | None
    """On the newest frame; None before the first one."""
    frame: int
    """Number of the newest frame, used or not; -1 before the first one."""
    stamp_s: float
    """Its capture on motion capture's clock; NaN before the first one."""
    received_s: float
    """Its arrival on ours; NaN before the first one."""
    vehicle: VehicleState | None
    """The estimate."""
    late: int = 0
    """Frames dropped so far because a newer one had come before them."""


@value
class HealthInputs:
    """Everything a health check may know; see health.assess."""

    time_s: float
    stage: Stage
    commanded: bool
    """The autopilot must be armed and in OFFBOARD: from arming until it is asked to disarm."""
    streaming: bool
    """Setpoints of ours leave."""
    airborne: bool
    """The law flies."""
    seen: MocapInputs
    autopilot: AutopilotStatus
    reference_w_m: Array | None
    """Where the vehicle should be now; None while the law sleeps."""
    sent: AttitudeThrust | None
    """The last setpoint that left; None when none did yet."""
    at_max_thrust: bool
    """The last cycle's thrust was cut at its upper limit."""
    law_fault: str
    """Why the law is no longer to be trusted; empty when it is."""
    late_s: float
    """How late this cycle began."""
    phase_since_s: float
    """Begin of the flight's phase."""
    landing_due_s: float
    """When the landing should be over, by its height and speed; infinite when none was begun."""
    held_by_fault_since_s: float
    """Begin of a hold that a fault caused; infinite when none did."""
    land_asked_s: float
    """When PX4 was first told to land and still shows OFFBOARD; infinite when it was not or obeyed."""
    arm_fault: str
    """What is wrong with the arms; empty when nothing is."""
    horizon_fault: str
    """How far the horizons are apart beyond what is corrected; empty when they are not."""
    operator_age_s: float
    """Since the broker was last there; 0 when none is configured."""
    disk_free_mb: float
    """Where records go; infinite when nothing is recorded to disk."""
