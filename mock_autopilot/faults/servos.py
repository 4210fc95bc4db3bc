"""Servo faults in PX4's words, as the simulated bus knows them; pure."""

from mock_autopilot.faults.catalogue import Kind
from mock_autopilot.faults.fault import Fault
from mock_autopilot.servos.config import Fault as BusFault
from mock_autopilot.servos.config import FaultKind

_KINDS = {
    (Kind.OFF, ""): FaultKind.SILENT_BUS,
    (Kind.OFF, "adapter"): FaultKind.PORT_GONE,
    (Kind.STUCK, ""): FaultKind.OVERLOAD,
    (Kind.GARBAGE, ""): FaultKind.CORRUPT,
    (Kind.WRONG, "hot"): FaultKind.HOT,
    (Kind.WRONG, "voltage"): FaultKind.VOLTAGE,
    (Kind.WRONG, "reboot"): FaultKind.REBOOT,
    (Kind.DELAYED, ""): FaultKind.LATE,
    (Kind.INTERMITTENT, ""): FaultKind.CORRUPT,
}


def bus_fault_of(fault: Fault) -> BusFault:
    """Return the fault of the servo bus to inject when this one begins, for all servos."""
    values: dict[str, object] = {"kind": _KINDS[fault.kind, fault.how], "for_s": fault.for_s}
    if fault.how == "voltage":
        values["volts_v"] = fault.magnitude
    if fault.kind is Kind.DELAYED:
        values["late_s"] = fault.magnitude
    if fault.kind is Kind.INTERMITTENT:
        values["every"] = round(1.0 / fault.magnitude)
    return BusFault.model_validate(values)
