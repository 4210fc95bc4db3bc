"""Frozen values that pass between the stages of one tick.

World frame W: right-handed, z up, metres. Body: FLU (forward, left, up). Quaternions: w x y z, unit,
turning body coordinates into W. Control code broadcasts, so vectors are (..., 3) and quaternions (..., 4).
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MocapFrame:
    """One body in one frame of the motion-capture system, as received."""

    frame: int
    """Frame number, counted by the motion-capture system."""
    stamp_s: float
    """Capture time on the motion-capture system's own clock."""
    received_s: float
    """Arrival on our monotonic clock."""
    position_w_m: Array
    """Shape (3,); NaN while the body is not tracked."""
    rotation_w_b: Array
    """Shape (3, 3), body FLU into W; NaN while the body is not tracked."""
    residual_m: float
    """Mean marker residual; NaN when not reported."""
    late: int = 0
    """Frames of this connection dropped so far because a newer one, or the same, had come before them."""

    @property
    def tracked(self) -> bool:
        """Whether the system saw the body in this frame."""
        return bool(np.isfinite(self.position_w_m).all() and np.isfinite(self.rotation_w_b).all())


@dataclass(frozen=True)
class VehicleState:
    """Where the vehicle is, as far as we know, at `time_s` on our monotonic clock."""

    time_s: float
    position_w_m: Array
    velocity_w_mps: Array
    q_w_flu_wxyz: Array
    rate_flu_radps: Array


@dataclass(frozen=True)
class Reference:
    """What the trajectory asks for at one instant; vectors (..., 3) in W."""

    position_w_m: Array
    velocity_w_mps: Array
    acceleration_w_mps2: Array
    yaw_rad: float


@dataclass(frozen=True)
class AttitudeThrust:
    """What the vehicle is asked to do: attitude (..., 4) and normalised thrust (...,) in 0..1."""

    q_w_flu_wxyz: Array
    thrust: Array


class FlightMode(StrEnum):
    """The autopilot's modes that this service tells apart."""

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
    """The battery's number in MAVLink: 0 for PX4's BAT1, 1 for BAT2; -1 before any was heard."""
    fraction: float
    """Remaining charge, 0..1."""
    voltage_v: float


@dataclass(frozen=True)
class AutopilotStatus:
    """What the autopilot last said of itself; ages are for the caller to compute from the times of arrival."""

    connected: bool
    heartbeat_s: float
    """Arrival of the last HEARTBEAT on our monotonic clock; -inf before the first: then nothing here is known."""
    armed: bool
    mode: FlightMode
    in_air: bool | None
    """What its land detector says; None before it has said anything, and while it does not know itself."""
    battery_fraction: float
    """Of the battery that carries the vehicle, `battery_id`; NaN while it is not known."""
    battery_v: float
    q_w_flu_wxyz: Array
    """The autopilot's own attitude estimate, already in our frames."""
    last_text: str
    """The newest STATUSTEXT; empty before the first, and when what it says was denied has come to pass."""
    text_s: float = -math.inf
    """Arrival of `last_text` on our monotonic clock; -inf before the first."""
    heard_s: float = -math.inf
    """Arrival of the newest message of any kind on our monotonic clock; -inf before the first."""
    attitude_s: float = -math.inf
    """Arrival of `q_w_flu_wxyz` on our monotonic clock; -inf before the first."""
    boot_s: float = math.nan
    """The autopilot's own time since its boot, as it last said; NaN before."""
    battery_id: int = -1
    """See BatteryReading."""
    batteries: tuple[BatteryReading, ...] = ()
    """All that were heard, by number."""
    system_id: int = 0
    """The autopilot's number in MAVLink (MAV_SYS_ID); 0 while it is not known."""
    strangers: tuple[str, ...] = ()
    """Other autopilots heard on this link, each in a few words."""
    failsafe: bool = False
    """It flies another mode than the chosen one: its failsafe, not a pilot, has taken the vehicle."""

    def said_since(self, time_s: float) -> str:
        """Return the newest STATUSTEXT if it came at `time_s` or later on our clock, else nothing."""
        return self.last_text if self.text_s >= time_s else ""

    @property
    def battery_name(self) -> str:
        """Return `the battery`, or `battery 0` where there is more than one."""
        return "the battery" if len(self.batteries) <= 1 else f"battery {self.battery_id}"


@dataclass(frozen=True)
class JointMotion:
    """What a joint trajectory asks for at one instant; (..., 8), the order of arms.model.JOINT_NAMES."""

    position_rad: Array
    velocity_radps: Array
    acceleration_radps2: Array


class ArmFaultKind(StrEnum):
    """What can be wrong with a servo, as far as reactions differ."""

    SILENT = "silent"
    """It does not answer any more, or its cable is out."""
    OVERLOAD = "overload"
    HARDWARE = "hardware"
    """Overheating, input voltage, encoder, electrical shock: whatever else the servo itself reports."""
    REBOOTED = "rebooted"
    """It answers, but has lost its torque without being told to."""
    BUS = "bus"
    """The port itself is gone."""


@dataclass(frozen=True)
class ArmFault:
    """One fault, latched: it stays until the operator clears it."""

    joint: str
    """Name in arms.model.JOINT_NAMES; "bus" when it is not one joint's."""
    kind: ArmFaultKind
    text: str
    """A sentence that names the joint and the servo's ID, and what to do."""


@dataclass(frozen=True)
class ArmStatus:
    """What the arms' bus last said; arrays are (8,), NaN where nothing was read yet."""

    read_s: Array
    """When each joint was last read, on our monotonic clock; -inf before the first time."""
    position_rad: Array
    velocity_radps: Array
    effort: Array
    """Present current or load as a share of the servo's rated one, signed as the joint."""
    temperature_c: Array
    voltage_v: Array
    torque_on: NDArray[np.bool_]
    held_rad: Array
    """The goals that hold the joints, which their loads keep them a little from; NaN where a joint gets none.

    It gets none while it is limp, has a fault, or was not given its torque by us, and obeys no goal then.
    """
    faults: tuple[ArmFault, ...]
    cycles: int
    """Bus cycles completed."""
    cycle_s: float
    """How long the last one took."""
    bad_packets: int
    """Answers that came late, broken or not at all, and were asked for again."""
