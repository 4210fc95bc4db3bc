"""Torque on, torque off, clearing faults: each a generator that gives way after every servo, so that cycles go on."""

from collections.abc import Callable, Generator

from companion.adapters.dynamixel.bus_cycle import ATTEMPTS, BusCycle
from companion.adapters.dynamixel.checks import misplaced
from companion.adapters.dynamixel.faults import described
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import Ax, Block, Xm
from companion.arms.model import CLAWS
from companion.core.interfaces import ArmError, Clock

Steps = Generator[None, None, None]
Repair = Generator[None, None, str | None]
"""Its value is what is still wrong."""
Action = Callable[[BusCycle, Joint], str | None]

REBOOT_S = 2.0
"""So long a rebooting XM may stay away."""
_FIRST_LOOK_S = 0.3
"""It may still answer just before it goes."""
_LOOK_EVERY_S = 0.05
_SETTLE_S = 0.2
"""An alarm may outlive its repair a little."""
_BENT_RAD = 0.1
"""So far a load may hold a joint from its goal; farther off, the goal is some other one. Not so a claw's: it grips."""
_SILENT = "does not answer: look at its cable and its supply"
_REFUSALS = {1: 0x5A, 2: 0x7F}
"""Bits of the error field that say that the instruction itself was not taken."""


def torque_on(bus_cycle: BusCycle) -> Steps:
    """Switch torque on at every joint's position; ArmError naming refusals. Does nothing while faults are latched."""
    if bus_cycle.faults.faults:
        said = "\n  ".join(fault.text for fault in bus_cycle.faults.faults)
        raise ArmError(f"torque stays as it is while faults are latched:\n  {said}")
    yield from _each(bus_cycle, _switch_on, "torque is not on everywhere")


def torque_off(bus_cycle: BusCycle) -> Steps:
    """Switch torque off on all joints; ArmError naming those that do not answer, after all others are off."""
    for joint in bus_cycle.joints:
        joint.driven = False  # before the first write: an AX takes torque on again with its next goal
    yield from _each(bus_cycle, _switch_off, "torque is not off everywhere")


def clear_faults(bus_cycle: BusCycle, clock: Clock) -> Steps:
    """Forget what is over; reboot XMs with a hardware error; ArmError naming what is still wrong."""
    problems = []
    for joint in bus_cycle.joints:
        if joint.faults:
            problem = yield from _cleared(bus_cycle, joint, clock)
            if problem:
                problems.append(f"{joint.label} {problem}")
            yield
    if problems:
        raise ArmError("not all faults could be cleared:\n  " + "\n  ".join(problems))


def _each(bus_cycle: BusCycle, act: Action, headline: str) -> Steps:
    problems = []
    for joint in bus_cycle.joints:
        problem = act(bus_cycle, joint)
        if problem:
            problems.append(f"{joint.label} {problem}")
        yield
    if problems:
        raise ArmError(f"{headline}:\n  " + "\n  ".join(problems))


def _switch_on(bus_cycle: BusCycle, joint: Joint) -> str | None:
    """Write the present position as goal before torque, so that an old goal is never approached.

    One that has torque and stands near its goal keeps that: its load bends it away, and to begin where it stands would
    let it sink a little further with every connection, and a claw drop what it holds.
    """
    if joint.driven:
        return None
    if not bus_cycle.first_look(joint):
        return _SILENT
    if joint.faults:
        return "has a fault: clear it first"
    assert joint.reading is not None
    outside = misplaced(joint, joint.reading.position_rad)
    if outside:
        return outside
    counts = _first_goal(bus_cycle, joint)
    goal = joint.table.GOAL_POSITION.encoded(counts)
    problem = next(filter(None, (_write(bus_cycle, joint, *order) for order in _switching_on(joint, goal))), None)
    problem = problem or _not_shown(bus_cycle, joint, on=True)
    if problem is None:
        joint.begin_driving(joint.scale.joint_rad(counts))
    return problem


def _first_goal(bus_cycle: BusCycle, joint: Joint) -> int:
    """Return the first goal, counts: the goal that is held, or the present position."""
    assert joint.reading is not None
    register = joint.table.GOAL_POSITION
    block = Block(register.address, register.address + register.size)
    held = bus_cycle.ask(joint, block) if joint.torque_on else None
    if held is None:
        return joint.reading.counts
    counts = held.raw(register)
    bent_rad = abs(joint.scale.joint_rad(counts) - joint.reading.position_rad)
    return counts if bent_rad < _BENT_RAD or joint.index in CLAWS else joint.reading.counts


def _not_shown(bus_cycle: BusCycle, joint: Joint, on: bool) -> str | None:
    """Return an error text unless the servo reports the commanded torque state."""
    if not bus_cycle.insist(lambda: bus_cycle.read_health(joint)):
        return _SILENT
    if on and (joint.faults or not joint.torque_on):
        return "took the command but has no torque"
    return "took the command but still has torque" if joint.torque_on and not on else None


def _switching_on(joint: Joint, goal: bytes) -> list[tuple[int, bytes]]:
    """Return the writes that switch torque on; an AX needs goal and speed in one packet, as a goal switches it on."""
    if joint.protocol == 1:
        return [(Ax.GOAL_POSITION.address, goal + joint.profile), (Ax.TORQUE_ENABLE.address, b"\x01")]
    return [
        (Xm.PROFILE_ACCELERATION.address, joint.profile),
        (Xm.GOAL_POSITION.address, goal),
        (Xm.TORQUE_ENABLE.address, b"\x01"),
    ]


def _switch_off(bus_cycle: BusCycle, joint: Joint) -> str | None:
    off = _write(bus_cycle, joint, joint.table.TORQUE_ENABLE.address, b"\x00")
    return off or _not_shown(bus_cycle, joint, on=False)


def _write(bus_cycle: BusCycle, joint: Joint, address: int, data: bytes) -> str | None:
    """Write a register and return an error text, or None; every write may be repeated.

    Only reading it back proves a write: an acknowledgement has no number, and may be a late one of another write.
    """
    block = Block(address, address + len(data))
    for _ in range(ATTEMPTS):
        error = bus_cycle.wire.write(joint.protocol, joint.servo_id, address, data)
        if error is not None and error & _REFUSALS[joint.protocol]:
            return f"refuses {data.hex(' ')} for register {address} (error 0x{error:02x})"
        written = bus_cycle.ask(joint, block) if error is not None else None
        if written is not None and written.data == data:
            return None
    return f"does not keep {data.hex(' ')} in register {address}, or does not answer: look at its cable and its supply"


def _cleared(bus_cycle: BusCycle, joint: Joint, clock: Clock) -> Repair:
    joint.driven, joint.paused = False, True
    try:
        problem = yield from _repaired(bus_cycle, joint, clock)
    finally:
        joint.paused = False
    if problem is not None:
        return problem
    bus_cycle.faults.forget(joint)
    if not bus_cycle.first_look(joint):
        return _SILENT
    return "is at fault again" if joint.faults else None


def _repaired(bus_cycle: BusCycle, joint: Joint, clock: Clock) -> Repair:
    errors = _errors(bus_cycle, joint)
    if errors is None:
        return _SILENT
    if not errors:
        return None
    if joint.protocol == 2:
        bus_cycle.wire.reboot(joint.servo_id)
        yield from _until_back(bus_cycle, joint, clock)
    else:
        problem = _restore_torque_limit(bus_cycle, joint)
        if problem:
            return problem
    errors = yield from _errors_left(bus_cycle, joint, clock)
    if errors is None:
        return _SILENT
    return f"still reports {described(errors, joint.protocol)}: remove the cause and try again" if errors else None


def _errors_left(bus_cycle: BusCycle, joint: Joint, clock: Clock) -> Generator[None, None, int | None]:
    begun_s = clock.now_s()
    while (errors := _errors(bus_cycle, joint)) and clock.now_s() - begun_s < _SETTLE_S:
        yield
    return errors


def _errors(bus_cycle: BusCycle, joint: Joint) -> int | None:
    answer = bus_cycle.ask(joint, joint.table.HEALTH, ATTEMPTS)
    return None if answer is None else joint.health_of(answer).trouble


def _until_back(bus_cycle: BusCycle, joint: Joint, clock: Clock) -> Steps:
    begun_s = clock.now_s()
    look_s = begun_s + _FIRST_LOOK_S
    while clock.now_s() - begun_s < REBOOT_S:
        yield
        if clock.now_s() >= look_s:
            if bus_cycle.wire.ping(2, joint.servo_id) is not None:
                return
            look_s = clock.now_s() + _LOOK_EVERY_S


def _restore_torque_limit(bus_cycle: BusCycle, joint: Joint) -> str | None:
    """Restore an AX's Torque Limit (34), which a shutdown sets to 0; torque off first, so that it stays limp."""
    identity = bus_cycle.ask(joint, Ax.IDENTITY)
    if identity is None:
        return _SILENT
    limit = Ax.TORQUE_LIMIT.encoded(identity.raw(Ax.MAX_TORQUE))
    return _write(bus_cycle, joint, Ax.TORQUE_ENABLE.address, b"\x00") or _write(
        bus_cycle, joint, Ax.TORQUE_LIMIT.address, limit
    )
