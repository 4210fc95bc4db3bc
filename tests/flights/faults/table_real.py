"""Flights over the real MAVSDK, qtm-rt and sockets, in real time: faults that live in the ends of the protocols."""

from companion.supervisor.faults import Fault
from tests.flights.faults.rows import MODE_S, REAL_S, RULES, End, Row, When, within

REFUSED = "autopilot wrong (refuses offboard)"
TWICE, NO_BROKER, BLOCK, STOP, KILL = "a second service", "broker stopped", "block", "SIGSTOP", "SIGKILL"
ANSWER_S = 5.0
"""[px4] answer_timeout_s: so long a mode may take to show."""


def _real(fault: Fault, variant: str, make: str, ends: End, limit_s: float, when: When = When.HOVER) -> Row:
    return Row(fault, f"{variant} (real link)", (make,), ends, limit_s + REAL_S, when)


REAL: tuple[Row, ...] = (
    _real(Fault.MOCAP_SILENT, "no frames any more", "mocap off", End.HANDED_OVER, within(RULES.silent_s)),
    _real(Fault.MOCAP_SILENT, "packets nobody can read", "mocap garbage (packets)", End.HANDED_OVER,
          within(RULES.silent_s)),
    _real(Fault.AUTOPILOT_SILENT, "the link is cut for 4 s", "link off for 4 s", End.HANDED_OVER,
          within(RULES.autopilot_silent_s)),
    _real(Fault.AUTOPILOT_SILENT, "it reboots", "autopilot wrong (reboot) by 2 s", End.TERMINATED,
          within(RULES.autopilot_silent_s)),
    _real(Fault.MODE_CHANGED, "a pilot takes over", "autopilot wrong (pilot takes over)", End.PILOT, within(MODE_S)),
    _real(Fault.OFFBOARD_REFUSED, "OFFBOARD is refused", REFUSED, End.NOT_STARTED, within(2 * ANSWER_S), When.GROUND),
    _real(Fault.SERVICE_TWICE, "a second service", TWICE, End.NOT_STARTED, within(0.0), When.GROUND),
    _real(Fault.OPERATOR_GONE, "the broker is stopped", NO_BROKER, End.FLIES_ON, within(RULES.operator_gone_s, 1.0)),
    _real(Fault.LOOP_STOPPED, "the event loop is blocked", BLOCK, End.HANDED_OVER, within(RULES.dead_man_s)),
    _real(Fault.LOOP_STOPPED, "SIGSTOP", STOP, End.HANDED_OVER, within(RULES.dead_man_s)),
    _real(Fault.LOOP_STOPPED, "SIGKILL", KILL, End.HANDED_OVER, within(RULES.dead_man_s)),
)  # fmt: skip
