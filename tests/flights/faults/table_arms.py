"""Flights in which a servo or the arms' bus goes wrong, with the arms' real driver."""

from companion.supervisor.faults import Fault
from mock_autopilot.servos.config import FaultKind
from tests.flights.faults.acts import one_servo
from tests.flights.faults.rows import ARMS, Act, End, Row, When, within

OURS, ON = End.LANDED, End.FLIES_ON
assert ARMS.config.arms is not None
SILENT_S = ARMS.config.arms.silent_s
ASKED_S = 0.05
"""A servo that does not answer is asked four times by itself."""
ALL_ASKED_S = 0.1
"""Eight that do not answer, one after the other: their time-outs make the cycles long."""
LOOKED_S = 0.02
"""Errors are read when the alert bit shows, every claw's in its turn."""


def _row(variant: str, make: str | Act, limit_s: float, end: End = OURS, when: When = When.SWINGING) -> Row:
    return Row(Fault.ARMS, variant, (make,), end, limit_s, when, harmless=end is ON, flown_with=ARMS)


ONE_SERVO = (
    _row("a servo does not answer", one_servo(FaultKind.MISSING, 6), within(SILENT_S, ASKED_S)),
    _row("a servo is overloaded", one_servo(FaultKind.OVERLOAD, 6), within(LOOKED_S)),
    _row("a claw is overloaded", one_servo(FaultKind.OVERLOAD, 4), within(LOOKED_S)),
    _row("a servo is too hot", one_servo(FaultKind.HOT, 1), within(LOOKED_S)),
    _row("a servo reboots", one_servo(FaultKind.REBOOT, 3), within(SILENT_S, ASKED_S)),
    _row("every answer of a servo comes 0.3 s late", one_servo(FaultKind.LATE, 5, late_s=0.3),
         within(SILENT_S, ASKED_S)),
    _row("every answer of a servo is broken", one_servo(FaultKind.CORRUPT, 7), within(SILENT_S, ASKED_S)),
    _row("a servo's answers are late for 0.1 s", one_servo(FaultKind.LATE, 5, for_s=0.1), 0.0, ON),
    _row("every third answer of a servo is broken", one_servo(FaultKind.CORRUPT, 2, every=3), 0.0, ON),
)  # fmt: skip

ALL_SERVOS = (
    _row("the bus falls silent", "servos off", within(SILENT_S, ALL_ASKED_S)),
    _row("the bus falls silent", "servos off", within(SILENT_S, ALL_ASKED_S), OURS, When.LANDING),
    _row("the bus falls silent", "servos off", within(SILENT_S, ALL_ASKED_S), End.NOT_STARTED, When.GROUND),
    _row("the bus falls silent for 0.15 s", "servos off for 0.15 s", 0.0, ON),
    _row("the adapter is pulled", "servos off (adapter)", within(0.0)),
    _row("every servo lets go", "servos stuck", within(LOOKED_S)),
    _row("a byte of every answer is wrong", "servos garbage", within(SILENT_S, ALL_ASKED_S)),
    _row("every second answer is broken", "servos intermittent", 0.0, ON),
    _row("the supply is low", "servos wrong (voltage)", within(LOOKED_S)),
    _row("every servo restarts", "servos wrong (reboot)", within(SILENT_S, ALL_ASKED_S)),
)  # fmt: skip

ARM_FAULTS = ONE_SERVO + ALL_SERVOS
