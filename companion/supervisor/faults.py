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
    TRAFFIC = "traffic"
    TRAFFIC_BLOCKED = "way blocked"
    SEPARATION_LOST = "separation lost"
    OTHER_UNSEEN = "other vehicle unseen"
    THRUST_SATURATED = "thrust saturated"
    LAW_FAILED = "control law failed"
    COMMAND_LATE = "command link late"
    GROUND_LAW_SILENT = "ground law silent"
    COMMAND_DELAYED = "commands delayed"
    COMMANDS_LOST = "commands lost"
    COMMANDS_REORDERED = "commands reordered"
    COMMANDS_FOREIGN = "foreign commands"
    GROUND_LAW_TWICE = "another ground law"
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


class PoseNeed(StrEnum):
    """Part of motion capture's pose without which a fault cannot be recognised; the value is its name in messages."""

    FRAMES = "motion capture"
    """The frames themselves."""
    ATTITUDE = "attitude comparison"
    """The true attitude, beside the autopilot's."""
    PLACE = "fence and tracking"
    """The true position, at every cycle."""


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
    needs: PoseNeed | None = None
    """None: it is recognised on a vehicle that gets no frames, too."""

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
_FRAMES, _ATTITUDE, _PLACE = PoseNeed.FRAMES, PoseNeed.ATTITUDE, PoseNeed.PLACE

TABLE: tuple[Row, ...] = (
    Row(fault=Fault.MOCAP_LATE, sign="newest usable frame older than {coast_s} s",
        why="five frames at 100 Hz: the law still predicts over this gap; from here on the guard reduces the tilt",
        flying=_WARN, landing=_WARN, ground=_WARN, needs=_FRAMES),
    Row(fault=Fault.MOCAP_DEGRADED, sign="newest usable frame older than {degraded_s} s",
        why="the velocity estimate is unreliable by now; the guard has levelled the vehicle, which costs least if the "
        "pose returns",
        flying=_WARN, landing=_WARN, ground=_WARN, needs=_FRAMES),
    Row(fault=Fault.MOCAP_SILENT, sign="no usable frame for {silent_s} s",
        why="at 1 m/s the vehicle has flown 0.25 m without a pose; PX4 lands by its own estimate, which drifts",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_FROZEN, sign="frames arrive, but the pose is identical to the last bit for {frozen_s} s",
        why="a measured pose has noise; the control loop would fly away from a constant one",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_NAN, sign="frames arrive without the body for {silent_s} s",
        why="covered markers; same as mocap silent",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_INVALID, sign="invalid rotation, or a position outside any room, for {silent_s} s",
        why="a corrupt or foreign stream; same as mocap silent",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_OUTLIERS,
        sign="frames farther from the last pose than the vehicle can have moved, for {silent_s} s",
        why="reflections, a partly covered body, or the pose of another body now and then; same as mocap silent",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_JUMPED,
        sign="ten frames agree on a pose that the vehicle cannot have reached (bodies swapped, mirrored, upside down, "
        "origin moved)",
        why="the pose before or the pose after the jump is wrong, and nothing tells which; vision is withheld from "
        "PX4 too",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_SLOW,
        sign="fewer than {slow_hz} usable frames in a second, and no late cycles that explain it",
        why="the filter's noise and the law's delay grow; enough frames to land with our controller",
        flying=_LAND, landing=_WARN, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_DELAYED,
        sign="median age over half a second above {delayed_s} s, or latency increased by that much",
        why="the clock estimate absorbs a constant delay, so that frames look fresh; the law is tuned to the known "
        "delay",
        flying=_LAND, landing=_WARN, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_OUT_OF_ORDER,
        sign="more than {out_of_order_share} of a second's frames older than one already used",
        why="each such frame is dropped; many of them mean that the network reorders packets or that two servers send",
        flying=_LAND, landing=_WARN, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.MOCAP_CLOCK_JUMP,
        sign="time stamps and arrival times of two consecutive frames disagree by {clock_jump_s} s",
        why="velocities and ages are computed from that clock",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_FRAMES),
    Row(fault=Fault.LIFT_OFF_UNSEEN,
        sign="motion capture shows no lift-off by the end of the thrust ramp; counts as flying unless PX4 reports "
        "that it is on the ground",
        why="the vehicle is too heavy, or it flies and motion capture tracks another body: PX4's landing is right in "
        "both cases, stopping the motors only in the first; vision is withheld from PX4 too",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.ATTITUDE_DISAGREES,
        sign="tilt by motion capture and by the autopilot {tilt_apart_rad} rad apart for {apart_s} s",
        why="mirrored axes or a slipped marker plate: PX4 flies by its own horizon, which the motion does not "
        "contradict",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_ATTITUDE),
    Row(fault=Fault.HORIZON_WRONG,
        sign="tilts apart as above, and the motion agrees with the tilt by motion capture, not with the autopilot's",
        why="PX4 would land by its wrong horizon and fly sideways; our position control compensates as long as the "
        "tilt limit allows; while it lasts, tracking lost and battery critical also lead to our own landing",
        flying=_LAND, landing=_WARN, ground=_DISARM, needs=_ATTITUDE),
    Row(fault=Fault.HORIZON_LOST, sign="autopilot's horizon wrong, and the predicted stopping point outside the fence",
        why="neither our landing nor PX4's keeps the vehicle inside: a fall here is safer than flying into the net",
        flying=_TERMINATE, landing=_TERMINATE, ground=_DISARM, needs=_ATTITUDE),
    Row(fault=Fault.HORIZON_CAPPED,
        sign="slow part of the tilt difference, motion capture less autopilot, above [control] horizon_cap_rad for "
        "{horizon_capped_s} s",
        why="one of the two attitudes is off by more than PX4's in normal flight: the part above the limit pushes the "
        "vehicle, and the law compensates; check for a tilted rigid body definition and the accelerometer calibration "
        "(docs/horizon.md)",
        flying=_WARN, landing=_WARN, ground=_WARN, needs=_ATTITUDE),
    Row(fault=Fault.HEADING_DISAGREES, sign="headings {heading_apart_rad} rad apart for {apart_s} s",
        why="every correction acts in a wrong direction, and the vehicle circles (toilet bowl)",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_ATTITUDE),
    Row(fault=Fault.SETPOINT_NOT_FOLLOWED,
        sign="attitude {not_followed_rad} rad from the modelled response to the setpoints, on the ground from the "
        "tilt at arming, or no setpoint can be sent, for {not_followed_s} s",
        why="setpoints do not arrive, or a motor or propeller has failed; PX4's control loop is faster; on the "
        "ground, with the rotors spinning up, the vehicle is tipping over",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.TRACKING_ERROR, sign="more than {tracking_m} m from the reference for {tracking_s} s",
        why="ten times the usual error: the model or the room is not as configured; land while control holds",
        flying=_LAND, landing=_WARN, ground=_WARN, needs=_PLACE),
    Row(fault=Fault.TRACKING_LOST,
        sign="more than {lost_m} m from the reference, or more than {tracking_m} m and growing for {growing_s} s",
        why="our controller does not hold the vehicle",
        flying=_PX4, landing=_PX4, ground=_WARN, needs=_PLACE),
    Row(fault=Fault.FENCE_NEAR, sign="predicted stopping point outside the fence",
        why="the guard brakes at the same time; the trajectory must not push the vehicle farther",
        flying=_HOLD, landing=_WARN, ground=_WARN, needs=_PLACE),
    Row(fault=Fault.FENCE_LEFT, sign="position outside the fence",
        why="neither law nor guard kept the vehicle inside",
        flying=_PX4, landing=_PX4, ground=_DISARM, needs=_PLACE),
    Row(fault=Fault.ROOM_LEFT, sign="{beyond_m} m beyond the fence, and still armed",
        why="the net is next: a fall here is safer than flying into it; in all modes but OFFBOARD, PX4's landing and "
        "its failsafes a pilot controls the motors",
        flying=_TERMINATE, landing=_TERMINATE, ground=_DISARM, handed_over=_TERMINATE, needs=_PLACE),
    Row(fault=Fault.TRAFFIC,
        sign="held now, the vehicle would come to rest within {traffic_margin_m} m of another one's cylinder, within "
        "{yield_margin_m} m for the one that yields; for that one also: within {yield_ahead_s} s the ways meet",
        why="the guard brakes at the same time; the one that yields stops first and leaves the way, and 0.2 m between "
        "the margins let the other pass without a hold (docs/separation.md)",
        flying=_HOLD, landing=_WARN, ground=_WARN, needs=_PLACE),
    Row(fault=Fault.TRAFFIC_BLOCKED,
        sign="within {yield_margin_m} m of the cylinder of one that goes first, in flight, for {yield_s} s",
        why="the first one waits, or cannot pass: the later one gives the way free, so that no two wait for each other",
        flying=_LAND, landing=_WARN, ground=_WARN, needs=_PLACE),
    Row(fault=Fault.SEPARATION_LOST,
        sign="inside the cylinder of one that goes first, or of one that is parked; in the air it is traffic for the "
        "one that goes first, and where the other was not seen for {degraded_s} s, so that its place is a guess; "
        "before lift-off: one in flight comes within {yield_margin_m} m of it in {yield_ahead_s} s",
        why="one of the two must leave the air, and the first one holds still for it; on the ground the rotors stop: "
        "another one that flies may not come near, let alone above, once this one flies",
        flying=_LAND, landing=_WARN, ground=_DISARM, needs=_PLACE),
    Row(fault=Fault.OTHER_UNSEEN,
        sign="a vehicle seen before in this flight is not seen for {other_unseen_s} s",
        why="nobody knows where it flies: whoever stands still is found where it was; the guard keeps away from where "
        "the other would have stopped",
        flying=_HOLD, landing=_WARN, ground=_WARN, needs=_PLACE),
    Row(fault=Fault.THRUST_SATURATED, sign="thrust at its upper limit for {saturated_s} s",
        why="no thrust reserve against disturbances: weak battery, too much weight, or a failed motor",
        flying=_LAND, landing=_WARN, ground=_WARN),
    Row(fault=Fault.LAW_FAILED,
        sign="the law raises an exception, or gives no finite command for {not_finite_cycles} cycles",
        why="there is no valid attitude command",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.COMMAND_LATE,
        sign="no message that a law on the ground has sent in the last {command_late_s} s confirms the command that is "
        "held; from {command_coast_s} s on the guard reduces the tilt, and at {command_level_s} s the vehicle is level",
        why="three beats are missing; the last command is held, as between two events",
        flying=_WARN, landing=_WARN, ground=_WARN),
    Row(fault=Fault.GROUND_LAW_SILENT,
        sign="the same for {command_silent_s} s (cable, radio, computer or process gone, its motion capture lost, no "
        "plan of the vehicle), the ground law says that it has failed, or none has this vehicle",
        why="nobody corrects the vehicle; PX4 lands. A ground law that returns is used again after `companion resume` "
        "only",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.COMMAND_DELAYED,
        sign="median age of a second's messages at their arrival above {command_delayed_s} s",
        why="the law predicts over the age it measures, but is made for the one before the flight: with 0.08 s more it "
        "swings, and touches down hard",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.COMMANDS_LOST, sign="more than {commands_lost_share} of a second's messages do not arrive",
        why="lost commands are sent again, but the next gap may be the one that is too long; land while some arrive",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.COMMANDS_REORDERED,
        sign="more than {commands_late_share} of a second's messages arrive after a newer one",
        why="each of them is dropped, the newest counts; the network is not as it was measured",
        flying=_WARN, landing=_WARN, ground=_WARN),
    Row(fault=Fault.COMMANDS_FOREIGN,
        sign="datagrams with a wrong key, of another session, or played again, in the last second",
        why="all are dropped, none is flown: a wrong key file, a second ground law, or somebody who tries",
        flying=_WARN, landing=_WARN, ground=_WARN),
    Row(fault=Fault.GROUND_LAW_TWICE,
        sign="a ground law with the right key asks for the vehicle during a flight: a second one, or the first one "
        "restarted",
        why="it is refused: a law that begins in the air knows nothing of this flight",
        flying=_WARN, landing=_WARN, ground=_WARN),
    Row(fault=Fault.LOOP_LATE,
        sign="control cycles on average more than {loop_late_s} s late over a second, or so late that fewer than "
        "{slow_hz} frames were used in it",
        why="computer overloaded; one late cycle is bridged, and the watchdog timer handles a loop that stops",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.AUTOPILOT_SILENT, sign="nothing received from the autopilot for {autopilot_silent_s} s",
        why="PX4 does not receive us either and starts its own failsafe; a resumed stream would take over from it",
        flying=_RELEASE, landing=_RELEASE, ground=_RELEASE, handed_over=_RELEASE),
    Row(fault=Fault.AUTOPILOT_REBOOTED, sign="the autopilot's time since boot went back",
        why="its motors are off and its estimator restarts",
        flying=_RELEASE, landing=_RELEASE, ground=_DISARM),
    Row(fault=Fault.AUTOPILOT_DISARMED, sign="disarmed without our request",
        why="its motors are off",
        flying=_RELEASE, landing=_RELEASE, ground=_WARN),
    Row(fault=Fault.MODE_CHANGED, sign="the first message that shows a mode other than OFFBOARD",
        why="a pilot or a failsafe of PX4 controls the vehicle, and the service does not compete with it",
        flying=_RELEASE, landing=_RELEASE, ground=_RELEASE),
    Row(fault=Fault.LAND_REFUSED, sign="still in OFFBOARD {land_refused_s} s after the command to land",
        why="without setpoints PX4 lands by its own offboard-loss failsafe",
        flying=_WARN, landing=_WARN, ground=_WARN, handed_over=_RELEASE),
    Row(fault=Fault.BATTERY_LOW, sign="charge below {battery_low}",
        why="enough to fold the arms and land normally",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.BATTERY_CRITICAL, sign="charge below {battery_critical}",
        why="lands at once, without folding the arms",
        flying=_PX4, landing=_PX4, ground=_DISARM),
    Row(fault=Fault.ARMS, sign="a servo or the bus reports a fault, or does not answer",
        why="the arms hold their position; see docs/arms.md; with [arms] land_on_fault = false it is only reported",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.LANDING_TOO_LONG,
        sign="landing takes {landing_s} s longer than its descent should; time above another vehicle does not "
        "count, up to {landing_above_s} s",
        why="our own landing does not reach the ground; above another vehicle PX4 would land on it, unguarded",
        flying=_PX4, landing=_PX4, ground=_WARN),
    Row(fault=Fault.HOLD_TOO_LONG, sign="{hold_s} s in a hold caused by a fault",
        why="no operator answers, and the battery drains",
        flying=_LAND, landing=_WARN, ground=_WARN),
    Row(fault=Fault.OPERATOR_GONE, sign="no connection to the broker for {operator_gone_s} s",
        why="the flight does not need the broker; the pilot can still stop it by remote control",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.DISK_FULL, sign="less than {disk_free_mb} MB free where records are written",
        why="a flight is not ended for its record",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.OFFBOARD_REFUSED,
        sign="the autopilot's messages do not show OFFBOARD, or arming, after the request",
        why="an acknowledgement alone proves nothing; the autopilot's text is passed to the operator",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.SERVICE_TWICE, sign="another service holds the lock of this autopilot's link",
        why="two setpoint streams would compete for one vehicle; the second service does not start",
        flying=_WARN, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.LOOP_STOPPED, sign="no control cycle for {dead_man_s} s, for any reason",
        why="MAVSDK would repeat the last setpoint without end: the kernel ends the process, and PX4 lands by its "
        "offboard-loss failsafe",
        flying=_RELEASE, landing=_RELEASE, ground=_RELEASE, handed_over=_RELEASE),
    Row(fault=Fault.ABORT, sign="the operator commands abort (or land, or Ctrl-C)",
        why="the normal end of every phase; after a handover PX4 is commanded to land",
        flying=_LAND, landing=_WARN, ground=_DISARM),
    Row(fault=Fault.KILL, sign="the operator commands kill and confirms it",
        why="the last resort, immediate in every phase",
        flying=_TERMINATE, landing=_TERMINATE, ground=_TERMINATE, handed_over=_TERMINATE),
)  # fmt: skip

ROWS: dict[Fault, Row] = {row.fault: row for row in TABLE}


def reaction_to(fault: Fault, stage: Stage) -> FailsafeAction:
    """Return the table's failsafe action for a fault in a stage of the flight."""
    return ROWS[fault].reaction(stage)
