"""Looking for a servo that does not answer where it should: why, or where it answers instead."""

from collections.abc import Callable

from companion.adapters.dynamixel.bus_cycle import BusCycle
from companion.adapters.dynamixel.checks import WIZARD, answer_all, model_name
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.port import PortGoneError
from companion.adapters.dynamixel.registers import LIKELY_BAUDS
from companion.config.arms_config import ArmsConfig

ATTEMPTS = 3
_PATIENCE_MS = 5.0
"""Short, because the place of a missing servo is only a hint: eight IDs at seven baud rates must not take long."""
_LOW_IDS = range(1, 21)
"""IDs at which servos of Protocol 1.0 are looked for, which has no broadcast ping; 1 is the factory's."""


def partly_heard(bus_cycle: BusCycle, joint: Joint) -> str | None:
    """Return why a servo cannot be read though bytes come from it; None when it is silent."""
    if any(bus_cycle.wire.ping_answers(joint.protocol, joint.servo_id) for _ in range(2)):
        bus_cycle.ask(joint, joint.table.STATE)
        if not bus_cycle.wire.garbled:
            return f"answers pings but no reads: Status Return Level 0, and should be 2: {answer_all(joint)}"
    elif not bus_cycle.wire.garbled:
        return None
    return (
        f"answers in broken packets: two servos have ID {joint.servo_id}, so take all others off the bus and give one "
        f"of them another {WIZARD}; or its cable is bad"
    )


def absent(bus_cycle: BusCycle, missing: list[Joint], config: ArmsConfig, stopped: Callable[[], bool]) -> list[str]:
    """Return a line for each servo that is silent, with where it was found instead, then lines on unconfigured."""
    if not missing:
        return []
    unconfigured = _unconfigured(bus_cycle)
    bus_cycle.wire.port.patience_ms = _PATIENCE_MS
    if any(joint.protocol == 1 for joint in missing):
        unconfigured += _unconfigured_of_protocol_1(bus_cycle)
    hints = {joint.index: _other_protocol(bus_cycle, joint) for joint in missing}
    hints |= _other_bauds(bus_cycle, [joint for joint in missing if not hints[joint.index]], config, stopped)
    lines = [
        f"{joint.label} does not answer at {config.baud} bits/s: "
        f"{hints[joint.index] or 'look at its cable, its supply and its ID'}"
        for joint in missing
    ]
    return lines + unconfigured


def ping(bus_cycle: BusCycle, joint: Joint, protocol: int) -> int | None:
    """Return its model number, if it answers within some attempts."""
    answers = (bus_cycle.wire.ping(protocol, joint.servo_id) for _ in range(ATTEMPTS))
    return next((number for number in answers if number is not None), None)


def _unconfigured(bus_cycle: BusCycle) -> list[str]:
    """List servos of Protocol 2.0 with an ID that is not configured: perhaps one of the missing."""
    known = {joint.servo_id for joint in bus_cycle.joints}
    return [
        f"ID {servo_id} answers, {model_name(number)}, but no joint has that ID: correct arms.servos or the servo's ID"
        for servo_id, number in sorted(bus_cycle.wire.broadcast_ping().items())
        if servo_id not in known
    ]


def _unconfigured_of_protocol_1(bus_cycle: BusCycle) -> list[str]:
    known = {joint.servo_id for joint in bus_cycle.joints if joint.protocol == 1}
    found = {servo_id: bus_cycle.wire.ping(1, servo_id) for servo_id in _LOW_IDS if servo_id not in known}
    return [
        f"ID {servo_id} answers by Protocol 1.0, {model_name(number)}, but no joint of that protocol has that ID: "
        "correct arms.servos or the servo's ID"
        for servo_id, number in found.items()
        if number is not None
    ]


def _other_protocol(bus_cycle: BusCycle, joint: Joint) -> str | None:
    other, model = 3 - joint.protocol, joint.scale.model
    number = ping(bus_cycle, joint, other)
    if number is None:
        return None
    if number == model.number:
        return f"it speaks Protocol {other}.0, so set its Protocol Type to {joint.protocol} {WIZARD}"
    return (
        f"{model_name(number)} answers there by Protocol {other}.0, and it should be {model.name} by "
        f"Protocol {joint.protocol}.0: exchange it, or correct its protocol or arms.servos.{joint.name}.model"
    )


def _other_bauds(
    bus_cycle: BusCycle, missing: list[Joint], config: ArmsConfig, stopped: Callable[[], bool]
) -> dict[int, str | None]:
    hints: dict[int, str | None] = {joint.index: None for joint in missing}
    likely = dict.fromkeys(baud for joint in missing for baud in LIKELY_BAUDS[joint.protocol] if baud != config.baud)
    try:
        for baud in likely:
            lost = [j for j in missing if hints[j.index] is None and baud in LIKELY_BAUDS[j.protocol]]
            if stopped():
                break
            if not lost or not _tuned(bus_cycle, baud):
                continue
            for joint in lost:
                if bus_cycle.wire.ping_answers(joint.protocol, joint.servo_id):
                    hints[joint.index] = f"it answers at {baud}, so set its Baud Rate {WIZARD}"
    finally:
        bus_cycle.wire.port.change_baud(config.baud)
    return hints


def _tuned(bus_cycle: BusCycle, baud: int) -> bool:
    """Change the port's baud rate for the search; return False where the adapter does not have that one."""
    try:
        bus_cycle.wire.port.change_baud(baud)
    except PortGoneError:
        return False
    return True
