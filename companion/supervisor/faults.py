"""Table of faults and their failsafe actions; docs/safety.md is printed from it.

The health checks (`health/`) turn measurements into events. This table assigns each event a failsafe action for each
stage of the flight, and the state machine (`state_machine.py`) executes the strongest one. Actions only escalate: only
the operator, or the end of the flight, ends one.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum


class FailsafeAction(IntEnum):
    """Failsafe actions, weakest first."""

    WARN = 0
    """Reported and recorded; the flight goes on."""
    DISARM = 1
    """On the ground: preparation ends, the motors stop. Never in the air."""
    HOLD = 2
    """Brake and hover; only the operator can continue the trajectory."""
    LAND = 3
    """Land with our own controller where the vehicle is, arms folded first."""
    AUTOPILOT_LAND = 4
    """Send a last, level setpoint and let PX4 land by itself."""
    RELEASE = 5
    """Send nothing more: the autopilot or its pilot has the vehicle."""
    TERMINATE = 6
    """Stop the motors at once, in the air too."""

    @property
    def words(self) -> str:
        """Name of the action in tables, logs and messages."""
        return "PX4 lands" if self is FailsafeAction.AUTOPILOT_LAND else self.name.lower().replace("_", " ")


class Stage(StrEnum):
    """Stages of a flight that differ in their failsafe actions."""

    GROUND = "ground"
    """The rotors stand still, or idle on the ground."""
    FLYING = "flying"
    LANDING = "landing"
    """With our own controller."""
    HANDED_OVER = "handed over"


class Fault(StrEnum):
    """Faults the supervisor detects; the value is the name in table, log, record and `faults.json`."""

    MOCAP_LATE = "mocap late"
    MOCAP_DEGRADED = "mocap degraded"
    MOCAP_SILENT = "mocap silent"
    MOCAP_FROZEN = "mocap frozen"
    MOCAP_NAN = "mocap lost the body"
    MOCAP_INVALID = "mocap invalid"
    MOCAP_OUTLIERS = "mocap implausible"
    MOCAP_JUMPED = "mocap jumped"
    MOCAP_SLOW = "mocap slow"
    MOCAP_DELAYED = "mocap delayed"
    MOCAP_OUT_OF_ORDER = "mocap out of order"
    MOCAP_CLOCK_JUMP = "mocap clock jumped"
    LIFT_OFF_UNSEEN = "lift-off not seen"
    ATTITUDE_DISAGREES = "attitudes disagree"
    HORIZON_WRONG = "autopilot's horizon wrong"
    HORIZON_LOST = "horizon wrong and fence near"
    HORIZON_CAPPED = "horizon correction at its limit"
    HEADING_DISAGREES = "headings disagree"
    SETPOINT_NOT_FOLLOWED = "setpoint not followed"
    TRACKING_ERROR = "tracking error"
    TRACKING_LOST = "tracking lost"
    FENCE_NEAR = "fence near"
    FENCE_LEFT = "fence left"
    ROOM_LEFT = "room left"
    THRUST_SATURATED = "thrust saturated"
    LAW_FAILED = "control law failed"
    LOOP_LATE = "loop late"
    AUTOPILOT_SILENT = "autopilot silent"
    AUTOPILOT_REBOOTED = "autopilot rebooted"
    AUTOPILOT_DISARMED = "autopilot disarmed"
    MODE_CHANGED = "mode changed"
    LAND_REFUSED = "landing refused"
    BATTERY_LOW = "battery low"
    BATTERY_CRITICAL = "battery critical"
    ARMS = "arms"
    LANDING_TOO_LONG = "landing too long"
    HOLD_TOO_LONG = "hold too long"
    OPERATOR_GONE = "broker gone"
    DISK_FULL = "disk full"
    OFFBOARD_REFUSED = "offboard refused"
    SERVICE_TWICE = "duplicate service"
    LOOP_STOPPED = "loop stopped"
    ABORT = "operator aborts"
    KILL = "operator kills"


@dataclass(frozen=True)
class Event:
    """A fault that is present now, with its message."""

    fault: Fault
    text: str
    """Description with numbers; begins in lower case, ends without a full stop."""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    fault: Fault
    sign: str
    """Condition that detects the fault; {names} are keys of SafetyRules, printed with their values."""
    why: str
    """Reason for this limit and these actions."""
    flying: FailsafeAction
    landing: FailsafeAction
    ground: FailsafeAction
    handed_over: FailsafeAction = FailsafeAction.WARN

    def reaction(self, stage: Stage) -> FailsafeAction:
        """Return the failsafe action in this stage of the flight."""
        return {
            Stage.GROUND: self.ground,
            Stage.FLYING: self.flying,
            Stage.LANDING: self.landing,
            Stage.HANDED_OVER: self.handed_over,
        }[stage]


_WARN, _DISARM, _HOLD, _LAND = FailsafeAction.WARN, FailsafeAction.DISARM, FailsafeAction.HOLD, FailsafeAction.LAND
_PX4, _RELEASE, _TERMINATE = FailsafeAction.AUTOPILOT_LAND, FailsafeAction.RELEASE, FailsafeAction.TERMINATE

TABLE: tuple[Row, ...] = (
    Row(Fault.MOCAP_LATE, "newest usable frame older than {coast_s} s",
        "five frames: the law predicts over that much as it does over every delay; the guard begins to flatten",
        _WARN, _WARN, _WARN),
    Row(Fault.MOCAP_DEGRADED, "newest usable frame older than {degraded_s} s",
        "velocity is a guess by now; the guard has levelled the vehicle, which costs the least if the pose comes back",
        _WARN, _WARN, _WARN),
    Row(Fault.MOCAP_SILENT, "no usable frame for {silent_s} s",
        "at 1 m/s a third of a metre is flown blind; PX4 lands on its own estimate, which drifts, but is there",
        _PX4, _PX4, _DISARM),
    Row(Fault.MOCAP_FROZEN, "frames arrive, the pose is the same to the last bit, for {frozen_s} s",
        "a measured pose has noise; one that never changes would be flown away from",
        _PX4, _PX4, _DISARM),
    Row(Fault.MOCAP_NAN, "frames arrive without the body for {silent_s} s",
        "covered markers; as silent",
        _PX4, _PX4, _DISARM),
    Row(Fault.MOCAP_INVALID, "no rotation, or outside of any room, for {silent_s} s",
        "a broken or foreign stream; as silent",
        _PX4, _PX4, _DISARM),
    Row(Fault.MOCAP_OUTLIERS, "frames further off than the vehicle can have moved, for {silent_s} s",
        "reflections, a half-covered body, another body now and then; as silent",
        _PX4, _PX4, _DISARM),
    Row(Fault.MOCAP_JUMPED, "ten frames agree on a place the vehicle cannot have reached (bodies swapped, mirrored, "
        "upside down, origin moved)",
        "one of two truths is wrong and we cannot tell which; vision is withheld from PX4, too",
        _PX4, _PX4, _DISARM),
    Row(Fault.MOCAP_SLOW, "fewer than {slow_hz} usable frames in a second, and no late cycles that explain it",
        "the filter's noise and the law's delay grow; still enough to land with",
        _LAND, _WARN, _DISARM),
    Row(Fault.MOCAP_DELAYED, "median age over half a second above {delayed_s} s, or the latency grew by that",
        "a steady delay looks like fresh frames to a clock that adapts; the law is tuned to the known one",
        _LAND, _WARN, _DISARM),
    Row(Fault.MOCAP_OUT_OF_ORDER, "more than {out_of_order_share} of a second's frames older than one already used",
        "each such frame is dropped; many mean that the network reorders or that two servers send",
        _LAND, _WARN, _DISARM),
    Row(Fault.MOCAP_CLOCK_JUMP, "stamp and arrival of two frames in a row disagree by {clock_jump_s} s",
        "velocities and ages hang on that clock",
        _PX4, _PX4, _DISARM),
    Row(Fault.LIFT_OFF_UNSEEN, "no lift-off by motion capture at the end of the thrust's ramp; flying, as long as PX4 "
        "does not say that it stands",
        "too heavy, or it flies and motion capture looks at another body: PX4's landing is right for both, and stopped "
        "motors for one; vision is withheld from PX4, too",
        _PX4, _PX4, _DISARM),
    Row(Fault.ATTITUDE_DISAGREES, "tilt of motion capture and autopilot {tilt_apart_rad} rad apart for {apart_s} s",
        "mirrored axes, a slipped marker plate: PX4 holds its own horizon, which the motion does not disprove",
        _PX4, _PX4, _DISARM),
    Row(Fault.HORIZON_WRONG, "tilts apart as above, and the vehicle moves as its tilt by motion capture explains, and "
        "not by the autopilot",
        "PX4 would land by its wrong horizon and fly sideways; our position control counters what leaves it room to "
        "tilt; as long as it lasts, tracking lost and battery critical are reasons for our landing, too",
        _LAND, _WARN, _DISARM),
    Row(Fault.HORIZON_LOST, "the autopilot's horizon wrong, and the predicted stopping point outside the fence",
        "our landing does not hold it, and PX4's would not: falling here is better than flying on into the net",
        _TERMINATE, _TERMINATE, _DISARM),
    Row(Fault.HORIZON_CAPPED, "the slow part of motion capture's tilt less the autopilot's above [control] "
        "horizon_cap_rad for {horizon_capped_s} s",
        "one of the two errs by more than PX4 in a sound flight: what is left pushes the vehicle, and the law counters "
        "it; a rigid body defined tilted, or an accelerometer to calibrate; see docs/horizon.md",
        _WARN, _WARN, _WARN),
    Row(Fault.HEADING_DISAGREES, "headings {heading_apart_rad} rad apart for {apart_s} s",
        "every correction goes sideways: the toilet bowl",
        _PX4, _PX4, _DISARM),
    Row(Fault.SETPOINT_NOT_FOLLOWED, "attitude {not_followed_rad} rad off the answer a healthy vehicle would give, "
        "on the ground off its tilt at arming, or no setpoint can be sent, for {not_followed_s} s",
        "setpoints do not arrive, or a motor or propeller fails; PX4 has the shorter loop; on the "
        "ground, with the rotors spinning up, it is tipping over",
        _PX4, _PX4, _DISARM),
    Row(Fault.TRACKING_ERROR, "further than {tracking_m} m from the reference for {tracking_s} s",
        "ten times the usual error: model or room is not what we think; slow down to land",
        _LAND, _WARN, _WARN),
    Row(Fault.TRACKING_LOST, "further than {lost_m} m from the reference, or above {tracking_m} m and growing for "
        "{growing_s} s",
        "our controller does not hold the vehicle",
        _PX4, _PX4, _WARN),
    Row(Fault.FENCE_NEAR, "the predicted stopping point is outside the fence",
        "the guard brakes at the same moment; the trajectory must not push on",
        _HOLD, _WARN, _WARN),
    Row(Fault.FENCE_LEFT, "outside the fence",
        "neither law nor guard kept it in",
        _PX4, _PX4, _DISARM),
    Row(Fault.ROOM_LEFT, "{beyond_m} m beyond the fence, and still armed",
        "the net is next; falling here is better than flying on there; in any mode but OFFBOARD, PX4's landing and its "
        "failsafes the motors are a pilot's",
        _TERMINATE, _TERMINATE, _DISARM, _TERMINATE),
    Row(Fault.THRUST_SATURATED, "thrust at its upper limit for {saturated_s} s",
        "no reserve against a disturbance: weak battery, too heavy, a motor gone",
        _LAND, _WARN, _WARN),
    Row(Fault.LAW_FAILED, "the law raises, or gives no finite command for {not_finite_cycles} cycles",
        "whatever else is right, nobody computes where to tilt",
        _PX4, _PX4, _DISARM),
    Row(Fault.LOOP_LATE, "control cycles on average later than {loop_late_s} s over a second, or so late that fewer "
        "than {slow_hz} frames were used in it",
        "computer overloaded; one late cycle is bridged, a stop is ended by the dead man",
        _LAND, _WARN, _DISARM),
    Row(Fault.AUTOPILOT_SILENT, "nothing heard from the autopilot for {autopilot_silent_s} s",
        "PX4 does not hear us either and starts its own failsafe; a stream that comes back would take it over again",
        _RELEASE, _RELEASE, _RELEASE, _RELEASE),
    Row(Fault.AUTOPILOT_REBOOTED, "its time since boot went back",
        "motors are off, its estimator begins anew",
        _RELEASE, _RELEASE, _DISARM),
    Row(Fault.AUTOPILOT_DISARMED, "disarmed without our asking",
        "motors are off",
        _RELEASE, _RELEASE, _WARN),
    Row(Fault.MODE_CHANGED, "the first message that shows another mode than OFFBOARD",
        "a pilot or a failsafe of PX4 has the vehicle: never fight over it",
        _RELEASE, _RELEASE, _RELEASE),
    Row(Fault.LAND_REFUSED, "still in OFFBOARD {land_refused_s} s after PX4 was told to land",
        "without setpoints PX4 lands by its own offboard-loss failsafe",
        _WARN, _WARN, _WARN, _RELEASE),
    Row(Fault.BATTERY_LOW, "below {battery_low} of its charge",
        "enough to fold the arms and land in order",
        _LAND, _WARN, _DISARM),
    Row(Fault.BATTERY_CRITICAL, "below {battery_critical} of its charge",
        "down at once, arms as they are",
        _PX4, _PX4, _DISARM),
    Row(Fault.ARMS, "a servo or the bus reports a fault, or is silent",
        "the arms hold still where they are; see docs/arms.md; [arms] land_on_fault = false makes it a note",
        _LAND, _WARN, _DISARM),
    Row(Fault.LANDING_TOO_LONG, "{landing_s} s longer in the landing than its descent should take",
        "our own landing does not get down",
        _PX4, _PX4, _WARN),
    Row(Fault.HOLD_TOO_LONG, "{hold_s} s in a hold that a fault began",
        "nobody answers, and the battery will not wait",
        _LAND, _WARN, _WARN),
    Row(Fault.OPERATOR_GONE, "no broker for {operator_gone_s} s",
        "the flight is the vehicle's own; the pilot's remote control is the other way to stop it",
        _WARN, _WARN, _DISARM),
    Row(Fault.DISK_FULL, "less than {disk_free_mb} MB free where records go",
        "a flight is worth more than its record",
        _WARN, _WARN, _DISARM),
    Row(Fault.OFFBOARD_REFUSED, "OFFBOARD or arming is not shown by the autopilot's own messages",
        "an acknowledgement proves nothing; the words of the autopilot are the operator's answer",
        _WARN, _WARN, _DISARM),
    Row(Fault.SERVICE_TWICE, "another service holds the lock of this autopilot's link",
        "two streams of setpoints fight over one vehicle; the second service does not start",
        _WARN, _WARN, _DISARM),
    Row(Fault.LOOP_STOPPED, "no control cycle for {dead_man_s} s, whatever the reason",
        "MAVSDK would repeat the last setpoint for ever: the kernel ends the process, PX4's offboard loss lands",
        _RELEASE, _RELEASE, _RELEASE, _RELEASE),
    Row(Fault.ABORT, "the operator says abort (or land, or Ctrl-C)",
        "the normal way down, from every phase; handed over, PX4 is asked to land",
        _LAND, _WARN, _DISARM),
    Row(Fault.KILL, "the operator says kill, and confirms",
        "the last resort, at once and in every phase",
        _TERMINATE, _TERMINATE, _TERMINATE, _TERMINATE),
)  # fmt: skip

ROWS: dict[Fault, Row] = {row.fault: row for row in TABLE}


def reaction_to(fault: Fault, stage: Stage) -> FailsafeAction:
    """Return the table's failsafe action for a fault in a stage of the flight."""
    return ROWS[fault].reaction(stage)
