"""Flights in which autopilot, law, loop, arms, operator or room go wrong."""

from companion.config.companion_config import CompanionConfig
from companion.config.flight_config import FlightConfig, RoomConfig
from companion.config.safety_config import FenceConfig, SafetyConfig
from companion.supervisor.faults import Fault
from mock_autopilot.physics.truth import Truth
from tests.flights.faults import acts
from tests.flights.faults.rows import ARMS as MOVING_ARMS
from tests.flights.faults.rows import BOOT_S, MODE_S, RULES, Act, Conditions, End, Row, When, within
from tests.flights.simulated import Flight

PX4, OURS, ON, OFF = End.HANDED_OVER, End.LANDED, End.FLIES_ON, End.TERMINATED
BATTERY_S = 0.5
"""One bad sample is not an empty battery."""
TOLD_S = 0.5
"""BATTERY_STATUS comes twice a second."""
WINDOW_S = 1.0
NARROW = CompanionConfig(
    fence=FenceConfig(x_m=(-1.5, 1.5), margin_m=0.3), room=RoomConfig(x_m=(-1.2, 1.2)),
    safety=SafetyConfig(tracking_m=4.0, lost_m=5.0),
)  # fmt: skip
"""A fence that can be left without leaving the real one; tracking errors say nothing, so that the fence must."""
PATIENT = CompanionConfig(
    flight=FlightConfig(climb_speed_mps=1.0), safety=SafetyConfig(tracking_m=4.9, lost_m=9.9),
)  # fmt: skip
SHORT_HOLD = CompanionConfig(
    fence=NARROW.fence, room=NARROW.room, safety=SafetyConfig(tracking_m=4.0, lost_m=5.0, hold_s=3.0),
)  # fmt: skip
PID = Conditions(law="pid")
HANGING_S = 8.0
"""The law lowers the thrust (2 to 3 s), PX4 decides that it has landed (0.7 to 2.3 s), and COM_DISARM_LAND passes."""

OWN_ERROR_RAD = 0.063
"""Three times what PX4's horizon errs by in flight, 1.2 degrees (recorded: 0.4 to 1.65, 5 at most): so much of a drift
may only bring it back to the true one. The reaction took 2.4 to 3.3 s in 30 draws of that error."""
IGNORED_S = 2.5
"""Until the law asks for another attitude than the one that stays: by where the last setpoint and the horizon's error
carry the vehicle, 1.1 to 1.9 s in eight draws."""
GYRO_DRIFTS = tuple(f"autopilot wrong (attitude off) by {0.02 * k:.2f} rad" for k in range(1, 41))
PLATE_SLIPS = ("mocap wrong (tilted) by 0.02 rad",) * 20


def bit_by_bit(sentences: tuple[str, ...], every_s: float) -> Act:
    """One after the other."""

    def begin(flight: Flight) -> None:
        world, left = flight.room.bench.world, list(sentences)
        begin_s = world.time_s

        def go_on(truth: Truth) -> None:
            if left and truth.time_s >= begin_s + every_s * (len(sentences) - len(left)):
                flight.room.inject(left.pop(0))

        world.observers.append(go_on)

    return begin


AUTOPILOT = (
    Row(Fault.AUTOPILOT_SILENT, "nothing comes from the autopilot", ("link off (from the autopilot)",), PX4,
        within(RULES.autopilot_silent_s), When.TRACK),
    Row(Fault.AUTOPILOT_SILENT, "the link is cut", ("link off",), PX4, within(RULES.autopilot_silent_s), When.TRACK),
    Row(Fault.AUTOPILOT_SILENT, "the link is cut for 2 s", ("link off for 2 s",), PX4,
        within(RULES.autopilot_silent_s), When.TRACK),
    Row(Fault.AUTOPILOT_SILENT, "the link is cut", ("link off",), PX4, within(RULES.autopilot_silent_s), When.LANDING),
    Row(Fault.AUTOPILOT_SILENT, "the link is cut for 0.3 s", ("link off for 0.3 s",), ON, 0.0, When.TRACK,
        harmless=True),
    Row(Fault.AUTOPILOT_SILENT, "30 % of the datagrams lost", ("link intermittent by 0.3",), ON, 0.0, When.TRACK,
        harmless=True),
    Row(Fault.AUTOPILOT_SILENT, "a broken byte in every second datagram", ("link garbage",), ON, 0.0, When.TRACK,
        harmless=True),
    Row(Fault.AUTOPILOT_SILENT, "the autopilot hangs", ("autopilot stuck",), OFF, within(RULES.autopilot_silent_s)),
    Row(Fault.AUTOPILOT_SILENT, "the autopilot loses its power", ("autopilot off",), OFF,
        within(RULES.autopilot_silent_s)),
    Row(Fault.AUTOPILOT_REBOOTED, "it reboots in 0.1 s", ("mocap off", "autopilot wrong (reboot) by 0.1 s"), OFF,
        within(0.0, 0.1 + BOOT_S), When.HANDED_OVER),
    Row(Fault.AUTOPILOT_SILENT, "it reboots in 3 s", ("autopilot wrong (reboot)",), OFF,
        within(RULES.autopilot_silent_s)),
    Row(Fault.AUTOPILOT_DISARMED, "it disarms in the air", ("autopilot wrong (disarms)",), OFF, within(1.0)),
    Row(Fault.AUTOPILOT_DISARMED, "it takes its safety line for the ground", (acts.safety_line(8.0),), OFF,
        within(HANGING_S), When.LANDING, flown_with=Conditions(PATIENT)),
    Row(Fault.MODE_CHANGED, "a pilot takes over", ("autopilot wrong (pilot takes over)",), End.PILOT, within(MODE_S)),
    Row(Fault.MODE_CHANGED, "a pilot takes over", ("autopilot wrong (pilot takes over)",), End.PILOT, within(MODE_S),
        When.TRACK),
    Row(Fault.MODE_CHANGED, "a pilot takes over", ("autopilot wrong (pilot takes over)",), End.PILOT, within(MODE_S),
        When.TAKEOFF),
    Row(Fault.MODE_CHANGED, "a pilot takes over", ("autopilot wrong (pilot takes over)",), End.PILOT, within(MODE_S),
        When.LANDING),
    Row(Fault.MODE_CHANGED, "a ground station lets it land", (acts.told_by_another(21),), PX4, within(MODE_S),
        When.TRACK),
    Row(Fault.LAND_REFUSED, "it refuses to land", ("autopilot wrong (refuses to land)", "mocap off"), PX4,
        within(RULES.silent_s + RULES.land_refused_s), When.HANDED_OVER),
    Row(Fault.BATTERY_LOW, "20 % left", ("autopilot wrong (battery low)",), OURS, within(BATTERY_S, TOLD_S),
        When.TRACK),
    Row(Fault.BATTERY_LOW, "20 % left", ("autopilot wrong (battery low)",), OURS, within(BATTERY_S, TOLD_S),
        When.LANDING),
    Row(Fault.BATTERY_CRITICAL, "8 % left", ("autopilot wrong (battery critical)",), PX4, within(BATTERY_S, TOLD_S),
        When.TRACK),
    Row(Fault.BATTERY_CRITICAL, "8 % left", ("autopilot wrong (battery critical)",), PX4, within(BATTERY_S, TOLD_S),
        When.LANDING),
    Row(Fault.BATTERY_CRITICAL, "2 % for 0.2 s", (acts.bad_battery_sample,), ON, 0.0, When.TRACK, harmless=True),
    Row(Fault.BATTERY_LOW, "20 % left", ("autopilot wrong (battery low)",), End.NOT_STARTED,
        within(BATTERY_S, TOLD_S), When.GROUND),
)  # fmt: skip

HORIZON = (
    *(Row(Fault.HORIZON_WRONG, "off by 0.4 rad", ("autopilot wrong (attitude off)",), OURS,
        within(RULES.apart_s), when) for when in (When.HOVER, When.TRACK, When.TAKEOFF, When.LANDING)),
    Row(Fault.HORIZON_WRONG, "off by 0.4 rad", ("autopilot wrong (attitude off)",), OURS,
        within(RULES.apart_s), When.SWINGING, flown_with=MOVING_ARMS),
    Row(Fault.HORIZON_WRONG, "it drifts by 0.1 rad/s", (bit_by_bit(GYRO_DRIFTS, 0.2),), OURS,
        within(RULES.apart_s, (RULES.tilt_apart_rad + OWN_ERROR_RAD) / 0.1)),
    *(Row(Fault.HORIZON_LOST, f"off by {off_rad} rad",
        (f"autopilot wrong (attitude off) by {off_rad} rad",), OFF, within(RULES.apart_s, 3.0), when)
      for off_rad, when in ((0.6, When.HOVER), (0.6, When.TRACK), (0.6, When.TAKEOFF), (-0.8, When.TRACK))),
    Row(Fault.HORIZON_CAPPED, "off by 0.11 rad, which is corrected in part",
        ("autopilot wrong (attitude off) by 0.11 rad",), ON, within(RULES.horizon_capped_s, 1.0)),
    Row(Fault.HORIZON_CAPPED, "off by 0.18 rad, which is not corrected",
        ("autopilot wrong (attitude off) by 0.18 rad",), ON, within(RULES.horizon_capped_s, 1.0), When.TRACK),
    Row(Fault.ATTITUDE_DISAGREES, "the autopilot's horizon is off by 0.4 rad", ("autopilot wrong (attitude off)",),
        End.NOT_STARTED, within(RULES.apart_s), When.GROUND),
    *(Row(Fault.ATTITUDE_DISAGREES, "the marker plate slips by 0.4 rad in a second", (bit_by_bit(PLATE_SLIPS, 0.05),),
        PX4, within(RULES.apart_s, 1.0), when) for when in (When.HOVER, When.TRACK, When.TAKEOFF)),
)  # fmt: skip

VEHICLE = (
    Row(Fault.SETPOINT_NOT_FOLLOWED, "setpoints are ignored", ("autopilot wrong (ignores setpoints)",), PX4,
        within(RULES.not_followed_s, IGNORED_S), When.TRACK),
    Row(Fault.SETPOINT_NOT_FOLLOWED, "a motor pulls it askew", ("autopilot wrong (motor)",), PX4,
        within(RULES.not_followed_s, 0.5), When.HOVER),
    Row(Fault.TRACKING_ERROR, "a push of 20 N for 0.5 s", (acts.gust((20.0, 0.0, 0.0), 0.5),), OURS,
        within(RULES.tracking_s, 1.0), When.HOVER, flown_with=PID),
    Row(Fault.TRACKING_LOST, "a push of 18 N for 2 s", (acts.gust((18.0, 0.0, 0.0), 2.0),), PX4,
        within(RULES.growing_s, 1.0), When.HOVER, flown_with=PID),
    Row(Fault.THRUST_SATURATED, "the motors give 62 % of their thrust", ("autopilot wrong (weak) to 0.62",), PX4,
        within(RULES.saturated_s, 0.5), When.HOVER),
    Row(Fault.FENCE_NEAR, "blown towards the fence", (acts.gust((24.0, 0.0, 0.0), 0.7),), OURS, within(2.0),
        When.HOVER, flown_with=Conditions(NARROW, "pid")),
    Row(Fault.FENCE_LEFT, "blown out of the fence", (acts.gust((27.0, 0.0, 0.0), 0.8),), PX4, within(2.0),
        When.HOVER, flown_with=Conditions(NARROW, "pid")),
    Row(Fault.ROOM_LEFT, "blown far out of the fence", (acts.gust((40.0, 0.0, 0.0), 0.8),), OFF, within(2.0),
        When.HOVER, flown_with=Conditions(NARROW, "pid")),
    Row(Fault.HOLD_TOO_LONG, "nobody answers a hold", (acts.gust((24.0, 0.0, 0.0), 0.7),), OURS, within(5.0),
        When.HOVER, patience_s=20.0, flown_with=Conditions(SHORT_HOLD, "pid")),
    Row(Fault.LANDING_TOO_LONG, "it bobs on its safety line", (acts.safety_line(16.0),), PX4,
        within(RULES.landing_s, 6.0), When.LANDING, flown_with=Conditions(PATIENT)),
)  # fmt: skip

SERVICE = (
    Row(Fault.LAW_FAILED, "the law raises", (acts.law_raises,), PX4, within(0.0), When.TRACK, flown_with=PID),
    Row(Fault.LAW_FAILED, "the law gives NaN", (acts.law_gives_nan,), PX4,
        within(0.01 * RULES.not_finite_cycles), When.TRACK, flown_with=PID),
    Row(Fault.LOOP_LATE, "every cycle takes 40 ms more", (acts.busy(0.04, 1000),), OURS, within(WINDOW_S), When.TRACK),
    Row(Fault.LOOP_LATE, "one cycle takes 80 ms more", (acts.busy(0.08, 1),), ON, 0.0, When.TRACK, harmless=True),
    Row(Fault.OPERATOR_GONE, "the broker is gone", (acts.broker_gone,), ON, within(RULES.operator_gone_s),
        When.TRACK),
    Row(Fault.OPERATOR_GONE, "the broker is gone", (acts.broker_gone,), End.NOT_STARTED,
        within(RULES.operator_gone_s), When.GROUND),
    Row(Fault.DISK_FULL, "100 MB left", (acts.disk_full,), ON, within(0.0), When.TRACK),
    Row(Fault.DISK_FULL, "100 MB left", (acts.disk_full,), End.NOT_STARTED, within(0.0), When.GROUND),
    *(Row(Fault.ABORT, "abort", (acts.abort,), end, within(0.0), when)
      for when, end in ((When.HOVER, OURS), (When.TRACK, OURS), (When.TAKEOFF, OURS), (When.GROUND, End.NOT_STARTED))),
    *(Row(Fault.KILL, "kill", (acts.kill,), end, within(0.0), when)
      for when, end in ((When.TRACK, OFF), (When.TAKEOFF, OFF), (When.LANDING, OFF), (When.GROUND, End.NOT_STARTED))),
)  # fmt: skip

FLIGHT = AUTOPILOT + HORIZON + VEHICLE + SERVICE
