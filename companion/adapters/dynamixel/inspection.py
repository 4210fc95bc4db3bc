"""Connecting: ask every servo who and how it is, change nothing, and raise one error with all that is wrong."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from companion.adapters.dynamixel.chain import Chain
from companion.adapters.dynamixel.checks import Found, complaints, found_ax, found_xm, model_name
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import FACTORY_BAUDS, Ax, Block, Xm
from companion.config_arms import ArmsConfig
from companion.ports import ArmError
from companion.types import ArmFaultKind


@dataclass(frozen=True)
class Inspected:
    """What connecting found."""

    found: tuple[Found | None, ...] = ()
    """By joint; None for a servo that did not answer."""
    complaints: tuple[str, ...] = ()
    """All that is missing or wrong."""


_ATTEMPTS = 3
_HINT_PATIENCE_MS = 5.0
"""Where a missing servo may be instead is only a hint: eight of them at six other baud rates must not take long."""


def inspect(chain: Chain, config: ArmsConfig, stopped: Callable[[], bool], strict: bool = True) -> Inspected:
    """Look at every servo and take its first state; ArmError when any is missing or wrong.

    Not `strict`: only when none answers; one that is missing or reports an error begins with its fault latched.
    `stopped` is asked between questions, so that an interrupted connect ends soon.
    """
    found: list[Found | None] = []
    for joint in chain.joints:
        if stopped():
            return Inspected()
        found.append(_found(chain, joint))
    missing = [joint for joint, one in zip(chain.joints, found, strict=True) if one is None]
    lines = [
        line for joint, one in zip(chain.joints, found, strict=True) if one for line in complaints(joint, one, config)
    ]
    absent = _absent(chain, missing, config, stopped)
    if (lines or absent) and (strict or len(missing) == len(chain.joints)):
        raise ArmError(f"the arms on {config.port} cannot be used:\n  " + "\n  ".join([*lines, *absent]))
    for joint, line in zip(missing, absent, strict=False):  # what comes after them speaks of strangers
        joint.in_group = False
        chain.faults.latch(joint, ArmFaultKind.SILENT, line.removeprefix(f"{joint.label} "))
    for joint, one in zip(chain.joints, found, strict=True):
        if one is not None and not _first_look(chain, joint, one):
            raise ArmError(f"the arms on {config.port} cannot be used: {joint.label} stopped answering")
    return Inspected(tuple(found), (*lines, *absent))


def _first_look(chain: Chain, joint: Joint, found: Found) -> bool:
    """A servo of another model is not read: its registers may mean something else."""
    joint.paused = found.model_number != joint.scale.model.number
    return joint.paused or chain.first_look(joint)


def _found(chain: Chain, joint: Joint) -> Found | None:
    number = _ping(chain, joint, joint.protocol)
    if number is None:
        return None
    if number != joint.scale.model.number:
        return Found(number, 0, 0.0, 0.0, 2, 0.0, 0.0, 0, 0, 0, 0)
    if joint.protocol == 2:
        blocks = [_read(chain, joint, block) for block in (Xm.IDENTITY, Xm.LIMITS, Xm.HEALTH, Xm.STATE)]
        return None if None in blocks else found_xm(*(data for data, _ in filter(None, blocks)))
    identity, state = _read(chain, joint, Ax.IDENTITY), _read(chain, joint, Ax.STATE)
    if identity is None or state is None:
        return None
    return found_ax(identity[0], state[0], joint.health_of(*state).trouble)


def _ping(chain: Chain, joint: Joint, protocol: int) -> int | None:
    answers = (chain.wire.ping(protocol, joint.servo_id) for _ in range(_ATTEMPTS))
    return next((number for number in answers if number is not None), None)


def _read(chain: Chain, joint: Joint, block: Block) -> tuple[bytes, int] | None:
    for _ in range(_ATTEMPTS):
        answer = chain.wire.read(joint.protocol, joint.servo_id, block)
        if answer is not None:
            return answer.data, answer.error
    return None


def _absent(chain: Chain, missing: list[Joint], config: ArmsConfig, stopped: Callable[[], bool]) -> list[str]:
    """A line for each servo that did not answer, with where it was found instead."""
    if not missing:
        return []
    strangers = _strangers(chain)
    chain.wire.port.patience_ms = _HINT_PATIENCE_MS
    hints = {joint.place: _other_protocol(chain, joint) for joint in missing}
    hints |= _other_bauds(chain, [joint for joint in missing if not hints[joint.place]], config, stopped)
    lines = [
        f"{joint.label} does not answer at {config.baud} bits/s: "
        f"{hints[joint.place] or 'look at its cable, its supply and its ID'}"
        for joint in missing
    ]
    return lines + strangers


def _strangers(chain: Chain) -> list[str]:
    """Servos of Protocol 2.0 with an ID that nobody has asked for: one of the missing, perhaps."""
    known = {joint.servo_id for joint in chain.joints}
    return [
        f"ID {servo_id} answers, {model_name(number)}, but no joint has that ID: correct arms.servos or the servo's ID"
        for servo_id, number in sorted(chain.wire.broadcast_ping().items())
        if servo_id not in known
    ]


def _other_protocol(chain: Chain, joint: Joint) -> str | None:
    other = 3 - joint.protocol
    number = _ping(chain, joint, other)
    if number is None:
        return None
    return (
        f"{model_name(number)} answers there by Protocol {other}.0, and it should be {joint.scale.model.name} by "
        f"Protocol {joint.protocol}.0: exchange it, or correct its protocol or arms.servos.{joint.name}.model"
    )


def _other_bauds(
    chain: Chain, missing: list[Joint], config: ArmsConfig, stopped: Callable[[], bool]
) -> dict[int, str | None]:
    hints: dict[int, str | None] = {joint.place: None for joint in missing}
    try:
        for baud in _others(config.baud):
            lost = [joint for joint in missing if hints[joint.place] is None]
            if stopped() or not lost:
                break
            chain.wire.port.change_baud(baud)
            for joint in lost:
                if chain.wire.ping(joint.protocol, joint.servo_id) is not None:
                    hints[joint.place] = f"it answers at {baud}, so set its Baud Rate with DYNAMIXEL Wizard 2.0"
    finally:
        chain.wire.port.change_baud(config.baud)
    return hints


def _others(baud: int) -> Iterator[int]:
    return (other for other in FACTORY_BAUDS if other != baud)
