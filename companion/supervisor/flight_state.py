"""Values of the flight's state machine: phases, inputs, requests, rules and its own state."""

import math
from dataclasses import dataclass
from enum import StrEnum

from companion.core.types import Array, FlightMode, OtherVehicle
from companion.core.values import value
from companion.guard.geofence import Fence
from companion.guard.separation import Separation
from companion.supervisor.faults import Event, FailsafeAction, Fault, Stage
from companion.trajectories.reference import Trajectory


class Phase(StrEnum):
    """Phases of a flight."""

    STANDBY = "standby"
    """Before the first flight; no setpoint is sent."""
    PREFLIGHT = "preflight"
    """Idle setpoints stream, so that PX4 accepts OFFBOARD and then arming."""
    ARMED = "armed"
    """Motors idle on the ground."""
    TAKEOFF = "takeoff"
    HOLD = "hold"
    TRACK = "track"
    STOW = "stow"
    """Hovering until the arms are folded for the landing."""
    LAND = "land"
    DISARMED = "disarmed"
    """The flight is over."""
    HANDED_OVER = "handed over"
    """The autopilot or its pilot flies the vehicle; nothing is sent until the operator arms again or resumes."""
    RESUME = "resume"
    """The operator takes the vehicle back from the autopilot: level setpoints stream until it reports OFFBOARD."""
    TERMINATED = "terminated"
    """The motors were stopped, on the ground or in the air."""


PHASES = tuple(Phase)
"""Phases by their numbers, as a report to a law on the ground has them."""
IN_THE_AIR = frozenset({Phase.TAKEOFF, Phase.HOLD, Phase.TRACK, Phase.STOW, Phase.LAND})
COMMANDED = IN_THE_AIR | {Phase.ARMED}
"""Phases in which the autopilot must be armed and in OFFBOARD."""
STREAMING = COMMANDED | {Phase.PREFLIGHT, Phase.RESUME}
"""Phases in which setpoints are sent."""
INACTIVE = frozenset({Phase.STANDBY, Phase.DISARMED, Phase.TERMINATED})
"""Phases before and after a flight of this service."""


class Action(StrEnum):
    """Commands of the flight loop to the autopilot, apart from setpoints."""

    DISARM = "disarm"
    AUTOPILOT_LAND = "autopilot land"
    OFFBOARD = "offboard"
    KILL = "kill"


@dataclass(frozen=True, kw_only=True)
class FlightRules:
    """Limits and times of the state machine; see config.FlightConfig."""

    hover_thrust: float = 0.5
    climb_speed_mps: float = 0.5
    climb_accel_mps2: float = 0.6
    braking_mps2: float = 2.0
    """Peak deceleration of a stop; must be the fence's value, or the reference would stop outside the fence."""
    spool_up_s: float = 1.0
    descent_speed_mps: float = 0.25
    lift_off_m: float = 0.02
    """Height above the ground that counts as flying."""
    lowest_hold_m: float = 0.3
    """Height above the ground below which a takeoff that is to hold lands: air that comes back moves a hover there."""
    lift_off_wait_s: float = 1.0
    """Wait for lift-off after the thrust ramp while PX4 reports landed; otherwise the attempt ends with the ramp."""
    quick_ramp: float = 0.8
    """Share of hover thrust reached in the spool-up time; the ramp continues slowly from there."""
    slow_ramp_ps: float = 0.15
    """Share of hover thrust a second: the vehicle should leave the ground gently."""
    ramp_overshoot: float = 1.25
    """The ramp goes on beyond hover thrust, which may be misjudged, up to this multiple."""
    touchdown_m: float = 0.06
    touchdown_speed_mps: float = 0.06
    touchdown_s: float = 0.3
    disarm_wait_unknown_s: float = 1.2
    """Time from touchdown to the disarm command if PX4's land detector does not report: it needs 0.8 s and more."""
    disarm_wait_in_air_s: float = 2.5
    """The same while it reports in air and PX4 would reject the command; the slowest recorded needed 2.35 s."""
    stuck_below_m: float = 0.4
    """Distance of the reference below a vehicle that does not move: it stands on hanging arms or on a crate."""
    stuck_s: float = 1.5
    stuck_thrust: float = 0.7
    """Share of hover thrust: below it, the vehicle stands on something, as it could not fly with less."""
    disarm_again_s: float = 12.0
    """Interval of the disarm command while the autopilot stays armed; longer than one attempt takes."""
    disarm_shows_s: float = 2.5
    """A vehicle that PX4 has landed shows OFFBOARD again when it disarms; the armed bit follows within two HEARTBEATs.

    PX4 v1.17: CURRENT_MODE reports the mode within 27 ms, HEARTBEAT the armed bit up to 1 s later.
    """
    land_again_s: float = 2.0
    """Interval of the land command while the autopilot, handed over, still holds our last setpoint in OFFBOARD."""
    kill_again_s: float = 0.3
    """Interval of the kill command while the autopilot stays armed."""
    kill_settles_s: float = 5.0
    """Disarmed for longer than this after a kill, the motors count as stopped; arming them later is allowed."""
    resume_s: float = 3.0
    """The autopilot must report OFFBOARD within this time after a resume request."""
    turn_radps: float = 1.0
    """Peak rate at which the heading changes on the way to a trajectory's start."""
    turn_accel_radps2: float = 1.0
    """Peak angular acceleration of the heading on that way."""
    stow_time_s: float = 6.0
    """Longest hover while the arms are stowed; after it the vehicle lands with the arms as they are."""
    keep_clear: Separation | None = None
    """Cylinder around other vehicles that no takeoff and no trajectory may lead into; None in a room of one vehicle."""
    land_clear: Separation | None = None
    """Cylinder around other vehicles that no landing leads into; None in a room of one vehicle."""
    land_inside: Fence | None = None
    """Fence in which a vehicle that is above another one looks for a place to land."""
    fence_margin_m: float = 0.3
    clear_ahead_s: float = 2.5
    """Time for which a moving vehicle is taken to go on as it moves."""
    land_on_arm_fault: bool = True
    """A servo fault ends the flight; False: the arms hold still and the flight goes on."""


@value(kw_only=True)
class FlightInputs:
    """Inputs of the state machine in one tick."""

    time_s: float
    position_w_m: Array
    velocity_w_mps: Array
    yaw_rad: float
    armed: bool
    mode: FlightMode
    arms_stowed: bool = True
    """The arms are folded for the landing; True for a vehicle without arms."""
    arm_fault: str = ""
    """Fault of the arms, naming the joint; empty without one."""
    cannot_stow: str = ""
    """Reason why the arms cannot be folded; empty when they can."""
    events: tuple[Event, ...] = ()
    """Faults present now, in the order of faults.TABLE; see health.checks.assess."""
    in_air: bool | None = None
    """State of the autopilot's land detector; None when unknown."""
    failsafe: bool = False
    """The autopilot's failsafe has chosen its mode."""
    text: str = ""
    """Text of the autopilot's newest status message."""
    text_s: float = -math.inf
    """Arrival of that message; -inf before the first."""
    others: tuple[OtherVehicle, ...] = ()
    """The other vehicles of the room."""
    pushed: bool = False
    """The guard has kept a setpoint away from another vehicle a moment ago, see LawStep.pushed."""
    pushed_now: bool = False
    """It has done so with the last setpoint."""
    thrust: float = math.nan
    """Thrust of the last setpoint sent, 0..1; NaN when unknown."""


@dataclass(frozen=True)
class ArmRequest:
    """Stream idle setpoints, so that OFFBOARD and arming become possible."""


@dataclass(frozen=True)
class TakeoffRequest:
    """Climb to a height above the ground where the vehicle stands."""

    height_m: float


@dataclass(frozen=True)
class TrackRequest:
    """Go to a trajectory's start, wait there, fly it, hold its end."""

    trajectory: Trajectory
    settle_s: float


@dataclass(frozen=True)
class LandRequest:
    """Come down where the vehicle is."""

    reason: str = ""
    """Reason, if the landing was not planned."""


@dataclass(frozen=True)
class HoldRequest:
    """Come to rest and hover; the trajectory is not continued."""


@dataclass(frozen=True)
class HandOverRequest:
    """Let the autopilot land: something flight-critical failed."""

    reason: str


@dataclass(frozen=True)
class ResumeRequest:
    """Take the vehicle back from the autopilot or its pilot, and hover."""


@dataclass(frozen=True)
class KillRequest:
    """Stop the motors at once; the sender has asked the operator to confirm."""


Request = (
    ArmRequest
    | TakeoffRequest
    | TrackRequest
    | HoldRequest
    | LandRequest
    | HandOverRequest
    | ResumeRequest
    | KillRequest
)


@dataclass(frozen=True)
class Leg:
    """One segment of the reference and the phase it is flown in."""

    phase: Phase
    trajectory: Trajectory


@dataclass(frozen=True, kw_only=True)
class FlightState:
    """State of the flight's state machine."""

    phase: Phase = Phase.STANDBY
    since_s: float = 0.0
    """Begin of the phase."""
    legs: tuple[Leg, ...] = ()
    """The leg being flown and those that follow."""
    leg_start_s: float = 0.0
    ground_w_m: Array | None = None
    """Position (3,) from which the vehicle takes off."""
    yaw_rad: float = 0.0
    airborne: bool = False
    """The law flies; False while the thrust ramps up or after touchdown."""
    still_since_s: float | None = None
    """Begin of the time in which a landing looks finished; None while it does not."""
    touched_down: bool = False
    theirs: bool = False
    """Handed over, and since then in a mode that is neither OFFBOARD nor PX4's landing: a pilot flies."""
    left_offboard: bool = False
    """Handed over, and since then in a mode other than OFFBOARD: PX4 has begun to land, or a pilot has taken over."""
    offboard_again_s: float = math.inf
    """Time at which it reported OFFBOARD again after landing; infinite while it does not."""
    disarm_asked_s: float | None = None
    """Time of the last disarm command after touchdown; None before the first."""
    command_sent_s: float = 0.0
    """Time of the last land or kill command after handing over; infinite when none is to be repeated."""
    level: FailsafeAction = FailsafeAction.WARN
    """The strongest failsafe action so far; only the operator can step back down."""
    cause: Fault | None = None
    """Fault that led to `level`; None for an operator's request."""
    landing_due_s: float = math.inf
    """Expected end of the descent; infinite before a landing."""
    action: Action | None = None
    """Command to the autopilot; set for exactly one tick."""
    reason: str = ""
    """Reason why the flight was ended or handed over."""
    takeoff_height_m: float = 0.0

    @property
    def stage(self) -> Stage:
        """Stage that selects the column of the fault table."""
        if self.phase in {Phase.HANDED_OVER, Phase.TERMINATED}:
            return Stage.HANDED_OVER
        if self.airborne:
            return Stage.LANDING if self.phase in {Phase.STOW, Phase.LAND} else Stage.FLYING
        return Stage.FLYING if self.phase is Phase.RESUME else Stage.GROUND

    @property
    def held_by_fault_since_s(self) -> float:
        """Begin of a hold caused by a fault; infinite without one."""
        held = self.phase is Phase.HOLD and self.level is FailsafeAction.HOLD
        return self.since_s if held else math.inf

    @property
    def landing_asked_s(self) -> float:
        """Time of the land command; infinite without one, once the landing has begun, or after a release."""
        asked = self.phase is Phase.HANDED_OVER and self.level is FailsafeAction.AUTOPILOT_LAND
        return self.since_s if asked and not self.left_offboard else math.inf
