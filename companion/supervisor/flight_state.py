"""What the phase machine speaks of: phases, facts, requests, rules and its own state. Plain values."""

import math
from dataclasses import dataclass
from enum import StrEnum

from companion.core.types import Array, FlightMode
from companion.core.values import value
from companion.supervisor.faults import Event, FailsafeAction, Fault, Stage
from companion.trajectories.reference import Trajectory


class Phase(StrEnum):
    """Where in a flight we are."""

    STANDBY = "standby"
    """Nothing is sent."""
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
    """The autopilot or its pilot has the vehicle; nothing is sent until the operator begins anew."""
    RESUME = "resume"
    """The operator wants the vehicle back from the autopilot: level setpoints stream until OFFBOARD shows."""
    TERMINATED = "terminated"
    """The motors were stopped, wherever it was."""


IN_THE_AIR = frozenset({Phase.TAKEOFF, Phase.HOLD, Phase.TRACK, Phase.STOW, Phase.LAND})
COMMANDED = IN_THE_AIR | {Phase.ARMED}
"""Phases in which the autopilot must be armed and in OFFBOARD."""
STREAMING = COMMANDED | {Phase.PREFLIGHT, Phase.RESUME}
"""Phases in which setpoints are sent."""


class Action(StrEnum):
    """What the flight loop has to ask of the autopilot, apart from setpoints."""

    DISARM = "disarm"
    AUTOPILOT_LAND = "autopilot land"
    OFFBOARD = "offboard"
    KILL = "kill"


@dataclass(frozen=True)
class FlightRules:
    """Numbers of the machine; see config.FlightConfig."""

    hover_thrust: float = 0.5
    climb_speed_mps: float = 0.5
    climb_accel_mps2: float = 0.6
    braking_mps2: float = 2.0
    """Peak deceleration of a stop: what the fence counts on, or the reference would stop outside of it."""
    spool_up_s: float = 1.0
    descent_speed_mps: float = 0.25
    lift_off_m: float = 0.02
    """Height above the ground that counts as flying."""
    lift_off_wait_s: float = 1.0
    """No lift-off within this after the ramp's end ends the attempt; at its end, unless PX4 says that it stands."""
    quick_ramp: float = 0.8
    """Share of hover thrust that is reached in the spool-up time; from there on the ramp is slow."""
    slow_ramp_ps: float = 0.15
    """Share of hover thrust a second: the vehicle should leave the ground gently."""
    ramp_overshoot: float = 1.25
    """The ramp goes on beyond hover thrust, which may be misjudged, up to this multiple."""
    touchdown_m: float = 0.06
    touchdown_speed_mps: float = 0.06
    touchdown_s: float = 0.3
    disarm_wait_unknown_s: float = 1.2
    """From touchdown until disarming is asked for where PX4's land detector is not heard: it takes 0.8 s and more."""
    disarm_wait_in_air_s: float = 2.5
    """The same while it says that the vehicle flies, and PX4 would deny it; the slowest recorded needed 2.35 s."""
    stuck_below_m: float = 0.4
    """The reference is so far below a vehicle that does not move: it stands on something, hanging arms or a crate."""
    stuck_s: float = 1.5
    stuck_thrust: float = 0.7
    """Share of hover thrust: who stands on something and should go on down winds it down below, who flies cannot."""
    disarm_again_s: float = 12.0
    """Ask again when the autopilot is still armed; longer than one attempt takes."""
    disarm_shows_s: float = 2.5
    """A vehicle that PX4 has landed shows OFFBOARD again when it disarms; the armed bit follows within two HEARTBEATs.

    PX4 v1.17: CURRENT_MODE tells the mode within 27 ms, HEARTBEAT the armed bit up to 1 s later.
    """
    land_again_s: float = 2.0
    """Handed over, but still in OFFBOARD on a setpoint of ours: ask the autopilot to land again."""
    kill_again_s: float = 0.3
    """Ask again while motors that were to stop still turn."""
    kill_settles_s: float = 5.0
    """Disarmed later than this, the motors have been stopped; who arms them afterwards is not stopped any more."""
    resume_s: float = 3.0
    """OFFBOARD must show within this after the operator asked for the vehicle."""
    turn_radps: float = 1.0
    """Peak rate at which the heading changes on the way to a trajectory's start."""
    turn_accel_radps2: float = 1.0
    """And the peak of its change."""
    stow_time_s: float = 6.0
    """Hover at most so long for the arms to be stowed, then land with them as they are."""
    land_on_arm_fault: bool = True
    """A servo fault ends the flight; False: the arms hold still and the flight goes on."""


@value
class FlightInputs:
    """What is known at a tick."""

    time_s: float
    position_w_m: Array
    velocity_w_mps: Array
    yaw_rad: float
    armed: bool
    mode: FlightMode
    arms_stowed: bool = True
    """Folded for the landing; True for a vehicle without arms."""
    arm_fault: str = ""
    """What is wrong with the arms, naming the joint; empty when nothing is."""
    cannot_stow: str = ""
    """Why the arms cannot be folded; empty when they can."""
    events: tuple[Event, ...] = ()
    """What is wrong now, in the order of faults.TABLE, see health.assess."""
    in_air: bool | None = None
    """What the autopilot's own land detector says; None when it is not known."""
    failsafe: bool = False
    """The autopilot's failsafe has chosen its mode."""
    text: str = ""
    """The autopilot's newest sentence."""
    text_s: float = -math.inf
    """When it came; -inf before the first."""
    thrust: float = math.nan
    """Of the last setpoint that left, 0..1; NaN when it is not known."""


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
    """Why, if the flight was to be another one."""


@dataclass(frozen=True)
class HoldRequest:
    """Come to rest and hover; what was flown is not taken up again."""


@dataclass(frozen=True)
class HandOverRequest:
    """Let the autopilot land: something flight-critical failed."""

    reason: str


@dataclass(frozen=True)
class ResumeRequest:
    """Take the vehicle back from the autopilot or its pilot, and hover."""


@dataclass(frozen=True)
class KillRequest:
    """Stop the motors at once; whoever sends it has had it confirmed."""


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
    """One stretch of reference and the phase it is flown in."""

    phase: Phase
    trajectory: Trajectory


@dataclass(frozen=True)
class FlightState:
    """The machine's state."""

    phase: Phase = Phase.STANDBY
    since_s: float = 0.0
    """Begin of the phase."""
    legs: tuple[Leg, ...] = ()
    """What is being flown and what follows."""
    leg_start_s: float = 0.0
    ground_w_m: Array | None = None
    """Where the vehicle stood."""
    yaw_rad: float = 0.0
    airborne: bool = False
    """The law flies; False while the thrust ramps up or after touchdown."""
    still_since_s: float | None = None
    """Since when a landing looks finished."""
    touched_down: bool = False
    theirs: bool = False
    """Handed over, and flown in a mode since that is neither ours nor PX4's landing: a pilot's, as are the motors."""
    left_offboard: bool = False
    """Handed over, and shown in another mode than OFFBOARD since: PX4 has begun to land, or a pilot has taken it."""
    offboard_again_s: float = math.inf
    """When it stood on the ground and showed OFFBOARD again after that; infinite while it does not."""
    disarm_asked_s: float | None = None
    """When the autopilot was last asked to disarm after touchdown."""
    asked_again_s: float = 0.0
    """When the autopilot was last asked to land after handing over, or to stop the motors; infinite: not any more."""
    level: FailsafeAction = FailsafeAction.WARN
    """The strongest reaction so far; only the operator goes back."""
    cause: Fault | None = None
    """What led to it; None for the operator's wish."""
    landing_due_s: float = math.inf
    """When the descent should be over."""
    action: Action | None = None
    """Set for exactly one tick."""
    reason: str = ""
    """Why the flight was ended or handed over."""
    takeoff_height_m: float = 0.0

    @property
    def stage(self) -> Stage:
        """What the table of reactions goes by."""
        if self.phase in {Phase.HANDED_OVER, Phase.TERMINATED}:
            return Stage.HANDED_OVER
        if self.airborne:
            return Stage.LANDING if self.phase in {Phase.STOW, Phase.LAND} else Stage.FLYING
        return Stage.FLYING if self.phase is Phase.RESUME else Stage.GROUND

    @property
    def held_by_fault_since_s(self) -> float:
        """Begin of a hold that a fault caused; infinite when none did."""
        held = self.phase is Phase.HOLD and self.level is FailsafeAction.HOLD
        return self.since_s if held else math.inf

    @property
    def landing_asked_s(self) -> float:
        """When the autopilot was told to land; infinite when it was not, has begun to, or when we have let go."""
        asked = self.phase is Phase.HANDED_OVER and self.level is FailsafeAction.AUTOPILOT_LAND
        return self.since_s if asked and not self.left_offboard else math.inf
