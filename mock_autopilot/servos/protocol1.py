"""Handling of packets by servos of Protocol 1.0, and their answers; pure.

Source: https://emanual.robotis.com/docs/en/dxl/protocol1/, "Instruction Details". Factory Reset answers with an
instruction error: a vehicle's servos are not reset over the bus.
"""

from collections.abc import Sequence

from mock_autopilot.servos.instructions import QUIET, READS_ONLY, Answer, act, find, sync_write
from mock_autopilot.servos.memory import Refusal
from mock_autopilot.servos.packets import BROADCAST_ID, Error1, Instruction, Packet, pack1
from mock_autopilot.servos.servo import Servo


def answers1(packet: Packet, servos: Sequence[Servo]) -> list[Answer]:
    """Let the servos that receive an instruction act on it; return their answers in order."""
    if packet.code == Instruction.BULK_READ and packet.intact:
        return _bulk_read(packet.params, servos)
    if packet.code == Instruction.SYNC_WRITE and packet.intact:
        sync_write(packet.params, 1, servos)
        return []
    answers = []
    for servo in servos:
        if packet.id in (servo.id, BROADCAST_ID):
            done = _do(packet, servo)
            if done is not None and packet.id != BROADCAST_ID:
                answers.append(_status(servo, *done))
    return answers


def _status(servo: Servo, error: int, data: bytes) -> Answer:
    return Answer((servo.id,), pack1(servo.id, servo.error | error, data), servo.return_delay_s)


def _do(packet: Packet, servo: Servo) -> tuple[int, bytes] | None:
    """Return error bits and data of the answer; None for no answer."""
    if not packet.intact:
        return Error1.CHECKSUM, b""
    level, params = servo.table.get("status_return_level"), packet.params
    match packet.code:
        case Instruction.PING:
            return 0, b""
        case Instruction.READ if len(params) == 2:
            data = servo.read(params[0], params[1])
            result = (Error1.RANGE, b"") if isinstance(data, Refusal) else (0, data)
            return result if level >= READS_ONLY else None
        case Instruction.WRITE if len(params) >= 2:
            result = _error(servo.write(params[0], params[1:])), b""
        case Instruction.REG_WRITE if len(params) >= 2:
            servo.registered = (params[0], params[1:])
            result = 0, b""
        case Instruction.ACTION if servo.registered is not None:
            result = _error(act(servo)), b""
        case _:
            result = Error1.INSTRUCTION, b""
    return result if level > READS_ONLY else None


def _error(refusal: Refusal | None) -> int:
    if refusal is None:
        return 0
    return Error1.ANGLE_LIMIT if refusal is Refusal.OVER_LIMIT else Error1.RANGE


def _bulk_read(params: bytes, servos: Sequence[Servo]) -> list[Answer]:
    """Return the answers: each servo waits for the one before it, so a missing one silences the rest."""
    answers = []
    for size, servo_id, address in zip(params[1::3], params[2::3], params[3::3], strict=False):
        servo = find(servos, servo_id)
        if servo is None or servo.table.get("status_return_level") == QUIET:
            break
        data = servo.read(address, size)
        answers.append(_status(servo, *((Error1.RANGE, b"") if isinstance(data, Refusal) else (0, data))))
    return answers
