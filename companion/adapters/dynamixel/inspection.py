"""Inspection of every servo on connecting: changes nothing and raises one error that lists all deviations."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from companion.adapters.dynamixel.bus_cycle import BusCycle
from companion.adapters.dynamixel.checks import complaints, remarks
from companion.adapters.dynamixel.found import Found, found_ax, found_xm
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import Ax, Xm
from companion.adapters.dynamixel.search import ATTEMPTS, absent, partly_heard, ping
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError
from companion.core.types import ArmFaultKind


@dataclass(frozen=True)
class Inspected:
    """Servo settings, deviations and remarks found while connecting."""

    found: tuple[Found | None, ...] = ()
    """By joint; None for a servo that did not answer."""
    complaints: tuple[str, ...] = ()
    """Missing servos and wrong settings, one line each."""
    remarks: tuple[str, ...] = ()


def inspect(bus_cycle: BusCycle, config: ArmsConfig, stopped: Callable[[], bool], strict: bool = True) -> Inspected:
    """Look at every servo and take its first state; ArmError when any is missing or wrong.

    Not `strict`: only when none answers; one that is missing or reports an error begins with its fault latched.
    `stopped` is asked between questions, so that an interrupted connect ends soon.
    """
    found: dict[int, Found] = {}
    unread: dict[int, str] = {}
    for joint in bus_cycle.joints:
        if stopped():
            return Inspected()
        one = _found(bus_cycle, joint)
        if one is not None:
            found[joint.index] = one
        elif why := partly_heard(bus_cycle, joint):
            unread[joint.index] = why
    answering = [(joint, found[joint.index]) for joint in bus_cycle.joints if joint.index in found]
    lines = [line for joint, one in answering for line in complaints(joint, one, config)]
    silent = [joint for joint in bus_cycle.joints if joint.index not in found and joint.index not in unread]
    missing = [joint for joint in bus_cycle.joints if joint.index in unread] + silent
    gone = [f"{joint.label} {unread[joint.index]}" for joint in missing if joint.index in unread]
    gone += absent(bus_cycle, silent, config, stopped)
    if (lines or gone) and (strict or not answering):
        raise ArmError(f"the arms on {config.port} cannot be used:\n  " + "\n  ".join([*lines, *gone]))
    for joint, line in zip(missing, gone, strict=False):  # the lines after them are of unconfigured servos
        joint.in_group = False
        bus_cycle.faults.latch(joint, ArmFaultKind.SILENT, line.removeprefix(f"{joint.label} "))
    for joint, one in answering:
        joint.paused = one.model_number != joint.scale.model.number  # its registers may differ
        if not (joint.paused or bus_cycle.first_look(joint)):
            raise ArmError(f"the arms on {config.port} cannot be used: {joint.label} stopped answering")
    left = [line for joint, one in answering for line in remarks(joint, one, config)]
    return Inspected(tuple(found.get(joint.index) for joint in bus_cycle.joints), (*lines, *gone), tuple(left))


def _found(bus_cycle: BusCycle, joint: Joint) -> Found | None:
    number = ping(bus_cycle, joint, joint.protocol)
    if number is None:
        return None
    if number != joint.scale.model.number:
        return Found(model_number=number)
    answers = bus_cycle.wire.ping_answers(joint.protocol, joint.servo_id)
    blocks = (Xm.IDENTITY, Xm.TUNING, Xm.HEALTH, Xm.STATE) if joint.protocol == 2 else (Ax.IDENTITY, Ax.STATE)
    said = [answer for block in blocks if (answer := bus_cycle.ask(joint, block, ATTEMPTS)) is not None]
    if len(said) < len(blocks):
        return None
    if joint.protocol == 2:
        return replace(found_xm(*said), answers=answers)
    identity, state = said
    return replace(found_ax(identity, state, joint.health_of(state).trouble), answers=answers)
