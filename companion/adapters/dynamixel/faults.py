"""Latched faults: what is wrong, with which joint, and what to do about it."""

import logging

from companion.adapters.dynamixel.conversion import Health
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import AX_ALARMS, OVERLOAD, XM_HARDWARE_ERRORS
from companion.core.types import ArmFault, ArmFaultKind

LOG = logging.getLogger(__name__)

BUS = "bus"
_AGAIN = "then clear the faults and switch torque on"


class FaultLog:
    """All that is latched; for the worker's thread, `faults` for any."""

    def __init__(self) -> None:
        self.faults: tuple[ArmFault, ...] = ()

    @property
    def bus_is_down(self) -> bool:
        """The port is not to be touched until the operator clears that."""
        return any(fault.kind is ArmFaultKind.BUS for fault in self.faults)

    def latch(self, joint: Joint, kind: ArmFaultKind, text: str) -> None:
        """Note a joint's fault once; it gets no goals any more."""
        if kind not in joint.faults:
            joint.faults.add(kind)
            self._add(ArmFault(joint.name, kind, f"{joint.label} {text}"))

    def latch_bus(self, text: str) -> None:
        """Note that the whole bus is out."""
        if not self.bus_is_down:
            self._add(ArmFault(BUS, ArmFaultKind.BUS, text))

    def forget(self, joint: Joint) -> None:
        """Clear a joint's faults."""
        joint.faults.clear()
        self.faults = tuple(fault for fault in self.faults if fault.joint != joint.name)

    def forget_bus(self) -> None:
        """Clear the bus's fault."""
        self.faults = tuple(fault for fault in self.faults if fault.joint != BUS)

    def _add(self, fault: ArmFault) -> None:
        LOG.warning("arms: %s", fault.text)
        self.faults = (*self.faults, fault)

    def judge(self, joint: Joint, health: Health) -> None:
        """Compare what a servo says with what it was told."""
        joint.torque_on = health.torque_on
        errors = health.errors if joint.faults else health.trouble
        if errors:
            self._latch_errors(joint, errors, health.torque_on and not health.spent)
        elif joint.driven and not joint.faults and _has_rebooted(joint, health):
            self.latch(
                joint,
                ArmFaultKind.REBOOTED,
                f"lost its torque or its settings without being told to: it has rebooted; look at its cable, {_AGAIN}",
            )
        if joint.faults:
            joint.driven = False

    def _latch_errors(self, joint: Joint, errors: int, torque_on: bool) -> None:
        torque = "still holds" if torque_on else "has no torque"
        if errors & OVERLOAD:
            self.latch(joint, ArmFaultKind.OVERLOAD, f"is overloaded and {torque}: take the load away, {_AGAIN}")
        if errors & ~OVERLOAD:
            said = described(errors & ~OVERLOAD, joint.protocol)
            self.latch(joint, ArmFaultKind.HARDWARE, f"reports {said} and {torque}: remove the cause, {_AGAIN}")

    def silent(self, joint: Joint, age_s: float) -> None:
        """It has not answered for too long."""
        joint.driven = False
        self.latch(
            joint,
            ArmFaultKind.SILENT,
            f"has not answered for {age_s:.2f} s: look at its cable and its supply, {_AGAIN}",
        )


def _has_rebooted(joint: Joint, health: Health) -> bool:
    """An AX takes torque on again with its next goal, but not the speed it was given."""
    forgotten = health.moving_speed is not None and health.moving_speed != int.from_bytes(joint.profile, "little")
    return forgotten or not health.torque_on


def described(errors: int, protocol: int) -> str:
    """The bits in words."""
    words = AX_ALARMS if protocol == 1 else XM_HARDWARE_ERRORS
    known = [word for bit, word in words.items() if errors & bit]
    return ", ".join(known) or f"an unknown error 0x{errors:02x}"
