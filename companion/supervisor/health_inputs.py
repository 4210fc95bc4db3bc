"""Inputs of the health checks: one cycle's measurements and states, as plain values."""

from math import nan

from companion.core.types import Array, AttitudeThrust, AutopilotStatus, OtherVehicle, Vec3, VehicleState
from companion.core.values import value
from companion.estimation.state import Verdict
from companion.law_link.link_status import LinkStatus
from companion.supervisor.faults import Stage


@value(kw_only=True)
class MocapInputs:
    """Motion capture in this cycle."""

    age_s: float
    """Time since the capture of the newest usable frame; infinite before the first one."""
    verdict: Verdict | None
    """Verdict on the newest frame; None before the first one."""
    frame: int
    """Number of the newest frame, used or not; -1 before the first one."""
    stamp_s: float
    """Capture time of that frame on motion capture's clock; NaN before the first one."""
    received_s: float
    """Arrival of that frame on our clock; NaN before the first one."""
    vehicle: VehicleState | None
    """The estimated state; None before the first usable frame."""
    late: int = 0
    """Frames dropped so far because a newer one had arrived before them."""


@value(kw_only=True)
class HealthInputs:
    """Inputs of all health checks in one cycle; see health.checks.assess."""

    time_s: float
    stage: Stage
    commanded: bool
    """The autopilot must be armed and in OFFBOARD: from arming to the disarm command."""
    streaming: bool
    """Our setpoints are being sent."""
    airborne: bool
    """The vehicle is in the air and the control law flies it."""
    mocap: MocapInputs
    autopilot: AutopilotStatus
    reference_w_m: Array | None
    """Reference position now, (3,); None while the law is not active."""
    sent: AttitudeThrust | None
    """The last setpoint sent; None before the first."""
    at_max_thrust: bool
    """The last cycle's thrust was at its upper limit."""
    law_fault: str
    """Failure of the control law or the guard; empty without one."""
    late_s: float
    """Delay with which this cycle began."""
    landing_due_s: float
    """Expected end of the landing, from its height and speed; infinite when none was begun."""
    held_by_fault_since_s: float
    """Begin of a hold caused by a fault; infinite without one."""
    land_asked_s: float
    """Time of the first land command while PX4 still reports OFFBOARD; infinite without one or after it obeyed."""
    arm_fault: str
    """Fault of the arms; empty without one."""
    horizon_fault: str
    """Message if the horizons differ by more than is corrected; empty otherwise."""
    operator_age_s: float
    """Time since the broker was last connected; 0 when none is configured."""
    disk_free_mb: float
    """Free space in the folder of the records; infinite when nothing is recorded to disk."""
    link: LinkStatus | None = None
    """Link to a law on the ground; None for a law on board."""
    others: tuple[OtherVehicle, ...] = ()
    """The other vehicles, as of the newest frame."""
    taking_off: bool = False
    """The rotors spin up for a takeoff, on the ground still."""
    path_w_m: tuple[Vec3, ...] = ()
    """Reference positions from now on, a point every separation.STEP_S; see way_ahead.WayAhead."""
    rest_w_m: Vec3 = (nan, nan, nan)
    """Position of the reference at rest if a hold were ordered now; NaN where no other vehicle is in reach."""
    command_age_s: float = 0.0
    """Time since that law confirmed its command for this flight; 0 for a law on board."""
