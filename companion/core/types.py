"""Frozen values that pass between the stages of one tick.

World frame W: right-handed, z up, metres. Body: FLU (forward, left, up). Quaternions: w x y z, unit,
turning body coordinates into W. Control code broadcasts, so vectors are (..., 3) and quaternions (..., 4).
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Vec3 = tuple[float, float, float]
"""Vector of one vehicle as floats, where arrays would be too slow."""
Scalar = float | Array
"""Number of one vehicle, or numbers of a batch: control code computes with both alike."""
Flag = bool | Mask
"""Truth value of one vehicle, or those of a batch."""


def unknown_vector() -> Array:
    """Return NaN as a vector (3,)."""
    return np.full(3, np.nan)


@dataclass(frozen=True)
class OtherService:
    """Another vehicle's service on the operators' broker."""

    vehicle: str
    """Its name there."""
    body: str
    """Its body in QTM; empty where an older service does not say it."""


@dataclass(frozen=True)
class OtherBody:
    """Another vehicle's body in one frame of the motion-capture system."""

    body: str
    """Its name in QTM."""
    position_w_m: Vec3 | None
    """None while it is not tracked, or QTM does not have it."""
    why_unseen: str = ""
    """Why QTM cannot show it, as part of a sentence; empty while it could."""


@dataclass(frozen=True, kw_only=True)
class MocapFrame:
    """One body in one frame of the motion-capture system, as received."""

    frame: int
    """Frame number, counted by the motion-capture system."""
    stamp_s: float
    """Capture time on the motion-capture system's own clock."""
    received_s: float
    """Arrival on the service's monotonic clock."""
    position_w_m: Array
    """Shape (3,); NaN while the body is not tracked."""
    rotation_w_b: Array
    """Shape (3, 3), body FLU into W; NaN while the body is not tracked."""
    residual_m: float
    """Mean marker residual; NaN when not reported."""
    late: int = 0
    """Frames of this connection dropped so far because they arrived after a newer one or twice."""
    others: tuple[OtherBody, ...] = ()
    """The other vehicles of [separation] order, in that order; empty where none are configured."""

    def is_same(self, other: "MocapFrame | None") -> bool:
        """Return True if the other is this frame, by its stamp, too: some QTM versions number every frame 1."""
        return other is not None and self.frame == other.frame and self.stamp_s == other.stamp_s

    @property
    def tracked(self) -> bool:
        """True if the system saw the body in this frame."""
        return bool(np.isfinite(self.position_w_m).all() and np.isfinite(self.rotation_w_b).all())


@dataclass(frozen=True, kw_only=True)
class GroundPose:
    """Position and heading that a law on the ground computed a command for: all that the vehicle gets of a pose."""

    time_s: float
    """Instant that it holds for, on the service's monotonic clock."""
    position_w_m: Array
    """Shape (3,)."""
    yaw_rad: float


@dataclass(frozen=True, kw_only=True)
class OtherVehicle:
    """Another vehicle's estimated motion; all NaN before its body was first seen."""

    body: str
    """Its name in QTM."""
    position_w_m: Vec3
    velocity_w_mps: Vec3
    unseen_s: float = 0.0
    """Time since its body was last seen; infinite before the first time."""
    parked: bool = False
    """It stands on the ground and does not move."""

    @property
    def known(self) -> bool:
        """True once its body was seen."""
        return self.unseen_s < math.inf


@dataclass(frozen=True)
class VehicleState:
    """Estimated state of the vehicle at `time_s` on the service's monotonic clock."""

    time_s: float
    position_w_m: Array
    velocity_w_mps: Array
    q_w_flu_wxyz: Array
    rate_flu_radps: Array
    others: tuple[OtherVehicle, ...] = ()
    """The other vehicles at the same instant, in the order of [separation]; empty where none are configured."""


@dataclass(frozen=True)
class Reference:
    """Reference of a trajectory at one instant; vectors (..., 3) in W."""

    position_w_m: Array
    velocity_w_mps: Array
    acceleration_w_mps2: Array
    yaw_rad: float


@dataclass(frozen=True)
class AttitudeThrust:
    """Setpoint: attitude (..., 4) and normalised thrust (...,) in 0..1."""

    q_w_flu_wxyz: Array
    thrust: Array


class FlightMode(StrEnum):
    """Flight modes of the autopilot that the service distinguishes."""

    OFFBOARD = "offboard"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    LAND = "land"
    RETURN = "return"
    MISSION = "mission"
    POSITION = "position"
    ALTITUDE = "altitude"
    MANUAL = "manual"
    OTHER = "other"


@dataclass(frozen=True, kw_only=True)
class BatteryReading:
    """The newest BATTERY_STATUS of one battery; NaN where the autopilot does not know."""

    id: int
    """The battery's number in MAVLink: 0 for PX4's BAT1, 1 for BAT2; -1 before the first message."""
    fraction: float
    """Remaining charge, 0..1."""
    voltage_v: float


@dataclass(frozen=True, kw_only=True)
class AutopilotStatus:
    """Newest status of the autopilot; callers compute ages from the times of arrival."""

    connected: bool
    heartbeat_s: float
    """Arrival of the last HEARTBEAT on the service's monotonic clock; -inf before the first: all else is unknown."""
    armed: bool
    mode: FlightMode
    in_air: bool | None
    """Output of its land detector; None before the first message, and while it is undecided."""
    battery_fraction: float
    """Remaining charge of the flight battery `battery_id`, 0..1; NaN while it is not known."""
    battery_v: float
    q_w_flu_wxyz: Array
    """The autopilot's own attitude estimate, converted to W and FLU."""
    last_text: str
    """The newest STATUSTEXT; empty before the first, and once the command it denied has succeeded."""
    text_s: float = -math.inf
    """Arrival of `last_text` on the service's monotonic clock; -inf before the first."""
    heard_s: float = -math.inf
    """Arrival of the newest message of any kind on the service's monotonic clock; -inf before the first."""
    attitude_s: float = -math.inf
    """Arrival of `q_w_flu_wxyz` and `rate_flu_radps` on the service's monotonic clock; -inf before the first."""
    rate_flu_radps: Array = field(default_factory=unknown_vector)
    """The autopilot's own body rate, (3,); NaN before the first."""
    velocity_w_mps: Array = field(default_factory=unknown_vector)
    """The velocity of its own estimate, (3,), in W where it takes its heading from vision; NaN before the first."""
    velocity_s: float = -math.inf
    """Arrival of `velocity_w_mps` on the service's monotonic clock; -inf before the first."""
    boot_s: float = math.nan
    """The autopilot's time since boot, as last reported; NaN before the first report."""
    battery_id: int = -1
    """Number of the flight battery; see BatteryReading."""
    batteries: tuple[BatteryReading, ...] = ()
    """Newest reading of every battery, sorted by number."""
    system_id: int = 0
    """The autopilot's MAVLink system ID (MAV_SYS_ID); 0 while it is not known."""
    other_autopilots: tuple[str, ...] = ()
    """Short description of every other autopilot received on this link."""
    failsafe: bool = False
    """True while it flies another mode than the selected one: its failsafe, not a pilot, has control."""

    def said_since(self, time_s: float) -> str:
        """Return the newest STATUSTEXT if it arrived at `time_s` or later, else an empty string."""
        return self.last_text if self.text_s >= time_s else ""

    @property
    def battery_name(self) -> str:
        """Return `the battery`, or `battery 0` where there is more than one."""
        return "the battery" if len(self.batteries) <= 1 else f"battery {self.battery_id}"


NOT_HEARD = AutopilotStatus(
    connected=True,
    heartbeat_s=-math.inf,
    armed=False,
    mode=FlightMode.OTHER,
    in_air=None,
    battery_fraction=math.nan,
    battery_v=math.nan,
    q_w_flu_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
    last_text="",
)
"""Status before the first message."""


@dataclass(frozen=True)
class JointMotion:
    """Reference of a joint trajectory at one instant; (..., 8), in the order of arms.model.JOINT_NAMES."""

    position_rad: Array
    velocity_radps: Array
    acceleration_radps2: Array


class ArmFaultKind(StrEnum):
    """Kind of a servo fault, as far as the failsafe actions differ."""

    SILENT = "silent"
    """It no longer answers, or its cable is unplugged."""
    OVERLOAD = "overload"
    HARDWARE = "hardware"
    """Overheating, input voltage, encoder, electrical shock: any other error that the servo reports."""
    REBOOTED = "rebooted"
    """It answers, but its torque is off without a command."""
    BUS = "bus"
    """The serial port has disappeared."""


@dataclass(frozen=True)
class ArmFault:
    """Latched fault: it stays until the operator clears it."""

    joint: str
    """Name in arms.model.JOINT_NAMES; "bus" when it does not belong to one joint."""
    kind: ArmFaultKind
    text: str
    """A sentence that names the joint and the servo's ID, and what to do."""


@dataclass(frozen=True, kw_only=True)
class ArmStatus:
    """Newest status of the servo bus; arrays are (8,), NaN where nothing was read yet."""

    read_s: Array
    """Time at which each joint was last read, on the service's monotonic clock; -inf before the first time."""
    position_rad: Array
    velocity_radps: Array
    effort: Array
    """Present current or load as a share of the servo's rated one, signed as the joint."""
    temperature_c: Array
    voltage_v: Array
    torque_on: Mask
    held_rad: Array
    """Goals that hold the joints (rad), slightly off their positions under load; NaN where a joint has no goal.

    A joint has none while it is limp, has a fault, or was not switched on by this service.
    """
    faults: tuple[ArmFault, ...]
    cycles: int
    """Number of completed bus cycles."""
    cycle_s: float
    """Duration of the last one."""
    bad_packets: int
    """Replies that were late, corrupted or missing, and were requested again."""
