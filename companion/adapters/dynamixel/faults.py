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
    """Latched faults; changed by the bus thread only, `faults` may be read by any thread."""

    def __init__(self) -> None:
        self.faults: tuple[ArmFault, ...] = ()

    @property
    def bus_is_down(self) -> bool:
        """Return True while a bus fault is latched; the port is not used until the operator clears it."""
        return any(fault.kind is ArmFaultKind.BUS for fault in self.faults)

    def latch(self, joint: Joint, kind: ArmFaultKind, text: str) -> None:
        """Latch a fault of a joint once; the joint gets no more goals."""
        if kind not in joint.faults:
            joint.faults.add(kind)
            self._add(ArmFault(joint.name, kind, f"{joint.label} {text}"))

    def latch_bus(self, text: str) -> None:
        """Latch a fault of the whole bus once."""
        if not self.bus_is_down:
            self._add(ArmFault(BUS, ArmFaultKind.BUS, text))

    def forget(self, joint: Joint) -> None:
        """Remove the latched faults of this joint, so that it may be driven again."""
        joint.faults.clear()
        self.faults = tuple(fault for fault in self.faults if fault.joint != joint.name)

    def forget_bus(self) -> None:
        """Remove the latched fault of the whole bus."""
        self.faults = tuple(fault for fault in self.faults if fault.joint != BUS)

    def _add(self, fault: ArmFault) -> None:
        LOG.warning("arms: %s", fault.text)
        self.faults = (*self.faults, fault)

    def judge(self, joint: Joint, health: Health) -> None:
        """Compare a servo's state with its commanded state, and latch the faults that this shows."""
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
        """Latch that a servo has not answered for `age_s`."""
        joint.driven = False
        self.latch(
            joint,
            ArmFaultKind.SILENT,
            f"has not answered for {age_s:.2f} s: look at its cable and its supply, {_AGAIN}",
        )


def _has_rebooted(joint: Joint, health: Health) -> bool:
    forgotten = health.moving_speed is not None and health.moving_speed != int.from_bytes(joint.profile, "little")
    return forgotten or not health.torque_on


def described(errors: int, protocol: int) -> str:
    """Return the error bits as text, separated by commas."""
    words = AX_ALARMS if protocol == 1 else XM_HARDWARE_ERRORS
    known = [word for bit, word in words.items() if errors & bit]
    return ", ".join(known) or f"an unknown error 0x{errors:02x}"
