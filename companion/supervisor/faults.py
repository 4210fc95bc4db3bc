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


@dataclass(frozen=True, kw_only=True)
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
    Row(fault=Fault.MOCAP_LATE, sign="newest usable frame older than {coast_s} s",
        why="five frames: the law predicts over that much as it does over every delay; the guard begins to flatten",
        flying=_WARN, landing=_WARN, ground=_WARN),
    Row(fault=Fault.MOCAP_DEGRADED, sign="newest usable frame older than {degraded_s} s",
        why="velocity is a guess by now; the guard has levelled the vehicle, which costs the least if the pose comes "
        "back",
        flying=_WARN, landing=_WARN, ground=_WARN),
    Row(fault=Fault.MOCAP_SILENT, sign="no usable frame for {silent_s} s",
        why="at 1 m/s a third of a metre is flown blind; PX4 lands on its own estimate, which drifts, but is there",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.MOCAP_FROZEN, sign="frames arrive, the pose is the same to the last bit, for {frozen_s} s",
        why="a measured pose has noise; one that never changes would be flown away from",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.MOCAP_NAN, sign="frames arrive without the body for {silent_s} s",
        why="covered markers; as silent",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.MOCAP_INVALID, sign="no rotation, or outside of any room, for {silent_s} s",
        why="a broken or foreign stream; as silent",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.MOCAP_OUTLIERS, sign="frames further off than the vehicle can have moved, for {silent_s} s",
        why="reflections, a half-covered body, another body now and then; as silent",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.MOCAP_JUMPED,
        sign="ten frames agree on a place the vehicle cannot have reached (bodies swapped, mirrored, "
        "upside down, origin moved)",
        why="one of two truths is wrong and we cannot tell which; vision is withheld from PX4, too",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.MOCAP_SLOW,
        sign="fewer than {slow_hz} usable frames in a second, and no late cycles that explain it",
        why="the filter's noise and the law's delay grow; still enough to land with",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.MOCAP_DELAYED,
        sign="median age over half a second above {delayed_s} s, or the latency grew by that",
        why="a steady delay looks like fresh frames to a clock that adapts; the law is tuned to the known one",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.MOCAP_OUT_OF_ORDER,
        sign="more than {out_of_order_share} of a second's frames older than one already used",
        why="each such frame is dropped; many mean that the network reorders or that two servers send",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.MOCAP_CLOCK_JUMP, sign="stamp and arrival of two frames in a row disagree by {clock_jump_s} s",
        why="velocities and ages hang on that clock",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.LIFT_OFF_UNSEEN,
        sign="no lift-off by motion capture at the end of the thrust's ramp; flying, as long as PX4 "
        "does not say that it stands",
        why="too heavy, or it flies and motion capture looks at another body: PX4's landing is right for both, and "
        "stopped motors for one; vision is withheld from PX4, too",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.ATTITUDE_DISAGREES,
        sign="tilt of motion capture and autopilot {tilt_apart_rad} rad apart for {apart_s} s",
        why="mirrored axes, a slipped marker plate: PX4 holds its own horizon, which the motion does not disprove",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.HORIZON_WRONG,
        sign="tilts apart as above, and the vehicle moves as its tilt by motion capture explains, and "
        "not by the autopilot",
        why="PX4 would land by its wrong horizon and fly sideways; our position control counters what leaves it room "
        "to tilt; as long as it lasts, tracking lost and battery critical are reasons for our landing, too",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.HORIZON_LOST,
        sign="the autopilot's horizon wrong, and the predicted stopping point outside the fence",
        why="our landing does not hold it, and PX4's would not: falling here is better than flying on into the net",
        flying=_TERMINATE, landing=_TERMINATE, ground=_DISARM),
    Row(fault=Fault.HORIZON_CAPPED, sign="the slow part of motion capture's tilt less the autopilot's above [control] "
        "horizon_cap_rad for {horizon_capped_s} s",
        why="one of the two errs by more than PX4 in a sound flight: what is left pushes the vehicle, and the law "
        "counters it; a rigid body defined tilted, or an accelerometer to calibrate; see docs/horizon.md",
        flying=_WARN, landing=_WARN, ground=_WARN),
    Row(fault=Fault.HEADING_DISAGREES, sign="headings {heading_apart_rad} rad apart for {apart_s} s",
        why="every correction goes sideways: the toilet bowl",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.SETPOINT_NOT_FOLLOWED,
        sign="attitude {not_followed_rad} rad off the answer a healthy vehicle would give, "
        "on the ground off its tilt at arming, or no setpoint can be sent, for {not_followed_s} s",
        why="setpoints do not arrive, or a motor or propeller fails; PX4 has the shorter loop; on the "
        "ground, with the rotors spinning up, it is tipping over",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.TRACKING_ERROR, sign="further than {tracking_m} m from the reference for {tracking_s} s",
        why="ten times the usual error: model or room is not what we think; slow down to land",
        flying=_LAND, landing=_WARN, ground=_WARN),
    Row(fault=Fault.TRACKING_LOST,
        sign="further than {lost_m} m from the reference, or above {tracking_m} m and growing for "
        "{growing_s} s",
        why="our controller does not hold the vehicle",
        flying=_PX4, landing=_PX4, ground=_WARN),
    Row(fault=Fault.FENCE_NEAR, sign="the predicted stopping point is outside the fence",
        why="the guard brakes at the same moment; the trajectory must not push on",
        flying=_HOLD, landing=_WARN, ground=_WARN),
    Row(fault=Fault.FENCE_LEFT, sign="outside the fence",
        why="neither law nor guard kept it in",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.ROOM_LEFT, sign="{beyond_m} m beyond the fence, and still armed",
        why="the net is next; falling here is better than flying on there; in any mode but OFFBOARD, PX4's landing "
        "and its failsafes the motors are a pilot's",
        flying=_TERMINATE, landing=_TERMINATE, ground=_DISARM, handed_over=_TERMINATE),
    Row(fault=Fault.THRUST_SATURATED, sign="thrust at its upper limit for {saturated_s} s",
        why="no reserve against a disturbance: weak battery, too heavy, a motor gone",
        flying=_LAND, landing=_WARN, ground=_WARN),
    Row(fault=Fault.LAW_FAILED, sign="the law raises, or gives no finite command for {not_finite_cycles} cycles",
        why="whatever else is right, nobody computes where to tilt",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.LOOP_LATE,
        sign="control cycles on average later than {loop_late_s} s over a second, or so late that fewer "
        "than {slow_hz} frames were used in it",
        why="computer overloaded; one late cycle is bridged, a stop is ended by the watchdog timer",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.AUTOPILOT_SILENT, sign="nothing heard from the autopilot for {autopilot_silent_s} s",
        why="PX4 does not hear us either and starts its own failsafe; a stream that comes back would take it over "
        "again",
        flying=_RELEASE, landing=_RELEASE, ground=_RELEASE, handed_over=_RELEASE),
    Row(fault=Fault.AUTOPILOT_REBOOTED, sign="its time since boot went back",
        why="motors are off, its estimator begins anew",
        flying=_RELEASE, landing=_RELEASE, ground=_DISARM),
    Row(fault=Fault.AUTOPILOT_DISARMED, sign="disarmed without our asking",
        why="motors are off",
        flying=_RELEASE, landing=_RELEASE, ground=_WARN),
    Row(fault=Fault.MODE_CHANGED, sign="the first message that shows another mode than OFFBOARD",
        why="a pilot or a failsafe of PX4 has the vehicle: never fight over it",
        flying=_RELEASE, landing=_RELEASE, ground=_RELEASE),
    Row(fault=Fault.LAND_REFUSED, sign="still in OFFBOARD {land_refused_s} s after PX4 was told to land",
        why="without setpoints PX4 lands by its own offboard-loss failsafe",
        flying=_WARN, landing=_WARN, ground=_WARN, handed_over=_RELEASE),
    Row(fault=Fault.BATTERY_LOW, sign="below {battery_low} of its charge",
        why="enough to fold the arms and land in order",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.BATTERY_CRITICAL, sign="below {battery_critical} of its charge",
        why="down at once, arms as they are",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.ARMS, sign="a servo or the bus reports a fault, or is silent",
        why="the arms hold still where they are; see docs/arms.md; [arms] land_on_fault = false makes it a note",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.LANDING_TOO_LONG, sign="{landing_s} s longer in the landing than its descent should take",
        why="our own landing does not get down",
        flying=_PX4, landing=_PX4, ground=_WARN),
    Row(fault=Fault.HOLD_TOO_LONG, sign="{hold_s} s in a hold that a fault began",
        why="nobody answers, and the battery will not wait",
        flying=_LAND, landing=_WARN, ground=_WARN),
    Row(fault=Fault.OPERATOR_GONE, sign="no broker for {operator_gone_s} s",
        why="the flight is the vehicle's own; the pilot's remote control is the other way to stop it",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.DISK_FULL, sign="less than {disk_free_mb} MB free where records go",
        why="a flight is worth more than its record",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.OFFBOARD_REFUSED, sign="OFFBOARD or arming is not shown by the autopilot's own messages",
        why="an acknowledgement proves nothing; the words of the autopilot are the operator's answer",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.SERVICE_TWICE, sign="another service holds the lock of this autopilot's link",
        why="two streams of setpoints fight over one vehicle; the second service does not start",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.LOOP_STOPPED, sign="no control cycle for {dead_man_s} s, whatever the reason",
        why="MAVSDK would repeat the last setpoint for ever: the kernel ends the process, PX4's offboard loss lands",
        flying=_RELEASE, landing=_RELEASE, ground=_RELEASE, handed_over=_RELEASE),
    Row(fault=Fault.ABORT, sign="the operator says abort (or land, or Ctrl-C)",
        why="the normal way down, from every phase; handed over, PX4 is asked to land",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.KILL, sign="the operator says kill, and confirms",
        why="the last resort, at once and in every phase",
        flying=_TERMINATE, landing=_TERMINATE, ground=_TERMINATE, handed_over=_TERMINATE),
)  # fmt: skip

ROWS: dict[Fault, Row] = {row.fault: row for row in TABLE}


def reaction_to(fault: Fault, stage: Stage) -> FailsafeAction:
    """Return the table's failsafe action for a fault in a stage of the flight."""
    return ROWS[fault].reaction(stage)
