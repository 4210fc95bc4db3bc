"""Flights in which motion capture goes wrong."""

from companion.supervisor.faults import Fault
from tests.flights.faults import acts
from tests.flights.faults.rows import RULES, End, Row, When, within
from tests.flights.simulated import BRISK

PX4, OURS, ON = End.HANDED_OVER, End.LANDED, End.FLIES_ON
TEN_FRAMES_S = 0.10
"""So many must agree before a new place is believed."""
WINDOW_S, DELAY_WINDOW_S = 1.0, 0.5
"""Over which frames are counted, and delays judged."""
RAMP_S = BRISK.spool_up_s + (1.25 - 0.8) / 0.15
"""Time to the end of the thrust's ramp."""

SILENT = (
    Row(Fault.MOCAP_LATE, "no frames for 60 ms", ("mocap off for 0.06 s",), ON, within(RULES.coast_s), When.TRACK),
    Row(Fault.MOCAP_DEGRADED, "no frames for 150 ms", ("mocap off for 0.15 s",), ON, within(RULES.degraded_s),
        When.TRACK),
    Row(Fault.MOCAP_SILENT, "no frames any more", ("mocap off",), PX4, within(RULES.silent_s)),
    Row(Fault.MOCAP_SILENT, "no frames any more", ("mocap off",), PX4, within(RULES.silent_s), When.TRACK),
    Row(Fault.MOCAP_SILENT, "no frames any more", ("mocap off",), PX4, within(RULES.silent_s), When.TAKEOFF),
    Row(Fault.MOCAP_SILENT, "no frames any more", ("mocap off",), PX4, within(RULES.silent_s), When.LANDING),
    Row(Fault.MOCAP_SILENT, "no frames any more", ("mocap off",), End.NOT_STARTED, within(RULES.silent_s), When.GROUND),
    Row(Fault.MOCAP_SILENT, "no frames for 1 s", ("mocap off for 1 s",), PX4, within(RULES.silent_s), When.TRACK),
    Row(Fault.MOCAP_SILENT, "packets nobody can read", ("mocap garbage (packets)",), PX4, within(RULES.silent_s)),
    Row(Fault.MOCAP_SILENT, "0.4 s late", ("mocap delayed by 0.4 s",), PX4, within(RULES.silent_s), When.TRACK),
    Row(Fault.MOCAP_SILENT, "3 frames a second", ("mocap slow to 3 Hz",), PX4, within(RULES.silent_s, 1.0 / 3.0)),
    Row(Fault.MOCAP_FROZEN, "the pose stands still", ("mocap stuck",), PX4, within(RULES.frozen_s)),
    Row(Fault.MOCAP_FROZEN, "the pose stands still", ("mocap stuck",), PX4, within(RULES.frozen_s), When.TRACK),
    Row(Fault.MOCAP_FROZEN, "the pose stands still", ("mocap stuck",), PX4, within(RULES.frozen_s), When.TAKEOFF),
    Row(Fault.MOCAP_FROZEN, "the pose stands still", ("mocap stuck",), PX4, within(RULES.frozen_s), When.LANDING),
    Row(Fault.MOCAP_DEGRADED, "the pose stands still for 120 ms", ("mocap stuck for 0.12 s",), ON,
        within(RULES.degraded_s), When.TRACK),
    Row(Fault.MOCAP_NAN, "the body is lost", ("mocap wrong (lost)",), PX4, within(RULES.silent_s), When.TRACK),
    Row(Fault.MOCAP_NAN, "the body is lost", ("mocap wrong (lost)",), PX4, within(RULES.silent_s), When.LANDING),
    Row(Fault.MOCAP_DEGRADED, "the body is lost for 150 ms", ("mocap wrong (lost) for 0.15 s",), ON,
        within(RULES.degraded_s), When.TRACK),
    Row(Fault.MOCAP_INVALID, "random places, no rotations", ("mocap garbage",), PX4, within(RULES.silent_s)),
    Row(Fault.MOCAP_INVALID, "random places, no rotations", ("mocap garbage",), PX4, within(RULES.silent_s),
        When.TRACK),
    Row(Fault.MOCAP_OUTLIERS, "reflections: another place in every frame", (acts.reflections,), PX4,
        within(RULES.silent_s)),
)  # fmt: skip

JUMPED = (*(
    Row(Fault.MOCAP_JUMPED, variant, (f"mocap wrong ({how}",), PX4, within(TEN_FRAMES_S), when)
    for variant, how, when in (
        ("0.5 m off at once", "jump)", When.HOVER),
        ("0.5 m off at once", "jump)", When.TRACK),
        ("0.5 m off at once", "jump)", When.TAKEOFF),
        ("0.5 m off at once", "jump)", When.LANDING),
        ("another body's pose", "swapped)", When.TRACK),
        ("upside down", "upside down)", When.HOVER),
        ("y mirrored", "mirrored)", When.TRACK),
        ("x and y swapped", "axes swapped)", When.TRACK),
        ("turned by half a turn", "turned) by 3 rad", When.HOVER),
        ("its heading 0.6 rad off at once", "turned) by 0.6 rad", When.HOVER),
        ("its heading 0.6 rad off at once", "turned) by 0.6 rad", When.TRACK),
    )),
    Row(Fault.MOCAP_OUTLIERS, "0.5 m off for five frames", ("mocap wrong (jump) for 0.05 s",), ON, 0.0,
        When.TRACK, harmless=True),
)  # fmt: skip

STREAM = (
    Row(Fault.MOCAP_SLOW, "20 frames a second", ("mocap slow to 20 Hz",), OURS, within(WINDOW_S), When.TRACK),
    Row(Fault.MOCAP_SLOW, "20 frames a second", ("mocap slow to 20 Hz",), OURS, within(WINDOW_S), When.LANDING),
    Row(Fault.MOCAP_SLOW, "60 % of the frames lost", ("mocap intermittent by 0.6",), OURS, within(WINDOW_S),
        When.TRACK),
    Row(Fault.MOCAP_SLOW, "20 % of the frames lost", ("mocap intermittent by 0.2",), ON, 0.0, When.TRACK,
        harmless=True),
    Row(Fault.MOCAP_DELAYED, "0.1 s late", ("mocap delayed by 0.1 s",), OURS, within(DELAY_WINDOW_S, 0.1), When.TRACK),
    Row(Fault.MOCAP_DELAYED, "0.1 s late for 0.2 s", ("mocap delayed by 0.1 s for 0.2 s",), ON, 0.0, When.TRACK,
        harmless=True),
    Row(Fault.MOCAP_OUT_OF_ORDER, "every second frame behind its successor", ("mocap wrong (out of order)",), OURS,
        within(WINDOW_S), When.TRACK),
    Row(Fault.MOCAP_CLOCK_JUMP, "stamps 1 s back", ("mocap wrong (clock jump) by -1 s",), PX4, within(TEN_FRAMES_S),
        When.TRACK),
    Row(Fault.MOCAP_CLOCK_JUMP, "stamps 1 s ahead", ("mocap wrong (clock jump)",), PX4, within(TEN_FRAMES_S)),
    Row(Fault.MOCAP_CLOCK_JUMP, "stamps 1 s ahead", ("mocap wrong (clock jump)",), PX4, within(TEN_FRAMES_S),
        When.LANDING),
    Row(Fault.MOCAP_CLOCK_JUMP, "stamps 1 min back", ("mocap wrong (clock jump) by -60 s",), PX4, within(TEN_FRAMES_S)),
)  # fmt: skip

ATTITUDE = (
    Row(Fault.MOCAP_JUMPED, "the marker plate is tilted by 0.4 rad at once", ("mocap wrong (tilted)",), PX4,
        within(TEN_FRAMES_S), When.HOVER),
    Row(Fault.HEADING_DISAGREES, "the autopilot's heading is off by 0.6 rad", ("autopilot wrong (heading off)",),
        PX4, within(RULES.apart_s), When.HOVER),
)  # fmt: skip

LIST = (
    *(
        Row(Fault.MOCAP_SILENT, variant, (f"mocap wrong ({how})",), ends, within(RULES.silent_s), when)
        for variant, how, ends, when in (
            ("our body renamed in QTM", "body renamed", End.NOT_STARTED, When.GROUND),
            ("our body renamed in QTM", "body renamed", PX4, When.TAKEOFF),
            ("another body defined in place of ours", "body replaced", PX4, When.TRACK),
            ("our body deleted in QTM", "body deleted", PX4, When.LANDING),
            ("6DOF no longer calculated", "no bodies", PX4, When.HOVER),
        )
    ),
    Row(Fault.LIFT_OFF_UNSEEN, "takeoff by the pose of a body that stands elsewhere", (acts.take_off_by_another_body,),
        PX4, within(acts.ANOTHER_BODY_S + RAMP_S), When.LIFT_OFF, patience_s=8.0),
    Row(Fault.MOCAP_LATE, "another body defined before ours", ("mocap wrong (body added)",), ON, 0.0, When.TRACK,
        harmless=True),
)  # fmt: skip
"""QTM's list of rigid bodies changes: no frame is believed unless our body is found in it."""

MOCAP = SILENT + JUMPED + STREAM + ATTITUDE + LIST
