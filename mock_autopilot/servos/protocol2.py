"""Handling of packets by servos of Protocol 2.0, and their answers; pure.

Source: https://emanual.robotis.com/docs/en/dxl/protocol2/, "Instruction Details". Factory Reset answers with an
instruction error: a vehicle's servos are not reset over the bus.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from mock_autopilot.servos.instructions import QUIET, READS_ONLY, Answer, act, find, sync_write, write_to
from mock_autopilot.servos.memory import Refusal
from mock_autopilot.servos.packets import BROADCAST_ID, Block, Error2, Instruction, Packet, fast_status, status2
from mock_autopilot.servos.servo import Servo

_ERROR = {
    Refusal.NO_SUCH_ADDRESS: Error2.ACCESS,
    Refusal.READ_ONLY: Error2.ACCESS,
    Refusal.LOCKED: Error2.ACCESS,
    Refusal.CUT_SHORT: Error2.DATA_LENGTH,
    Refusal.OUT_OF_RANGE: Error2.DATA_RANGE,
    Refusal.OVER_LIMIT: Error2.DATA_LIMIT,
    Refusal.SHUT_DOWN: Error2.RESULT_FAIL,
}
_CLEAR_TURNS = bytes([0x01, 0x44, 0x58, 0x4C, 0x22])
_TO_MANY = frozenset(
    {
        Instruction.SYNC_READ,
        Instruction.SYNC_WRITE,
        Instruction.BULK_READ,
        Instruction.BULK_WRITE,
        Instruction.FAST_SYNC_READ,
        Instruction.FAST_BULK_READ,
    }
)


@dataclass(frozen=True)
class _Read:
    """One servo's part of a sync or bulk read."""

    id: int
    address: int
    size: int


def answers2(packet: Packet, servos: Sequence[Servo], time_s: float) -> list[Answer]:
    """Let the servos that receive an instruction act on it; return their answers in order."""
    if packet.code == Instruction.STATUS:
        return []  # an answer that the host has sent back
    if packet.id == BROADCAST_ID and packet.intact and packet.code in _TO_MANY:
        return _answer_many(packet.code, packet.params, servos)
    answers = []
    for servo in sorted(servos, key=lambda servo: servo.id):
        if packet.id in (servo.id, BROADCAST_ID):
            done = _do(packet, servo, time_s)
            if done is not None and (packet.id != BROADCAST_ID or packet.code == Instruction.PING):
                answers.append(_status(servo, *done))
        elif packet.id == servo.secondary_id and packet.code == Instruction.WRITE and packet.intact:
            write_to([servo], packet.id, _word(packet.params, 0), packet.params[2:])
    return answers


def _answer_many(code: int, params: bytes, servos: Sequence[Servo]) -> list[Answer]:
    match code:
        case Instruction.SYNC_READ | Instruction.BULK_READ:
            return _read_in_turn(_reads(code, params), servos)
        case Instruction.FAST_SYNC_READ | Instruction.FAST_BULK_READ:
            return _read_together(_reads(code, params), servos)
        case Instruction.SYNC_WRITE:
            sync_write(params, 2, servos)
            return []
        case _:
            _bulk_write(params, servos)
            return []


def _status(servo: Servo, error: int, data: bytes) -> Answer:
    return Answer((servo.id,), status2(servo.id, servo.error | error, data), servo.return_delay_s)


def _do(packet: Packet, servo: Servo, time_s: float) -> tuple[int, bytes] | None:
    """Return error number and data of the answer; None for no answer."""
    if not packet.intact:
        return Error2.CRC, b""
    level, params = servo.table.get("status_return_level"), packet.params
    match packet.code:
        case Instruction.PING:
            return Error2.NONE, servo.model.number.to_bytes(2, "little") + bytes([servo.table.get("firmware_version")])
        case Instruction.READ if len(params) == 4:
            return _read(servo, _Read(servo.id, _word(params, 0), _word(params, 2))) if level >= READS_ONLY else None
        case Instruction.WRITE if len(params) >= 3:
            result = _error(servo.write(_word(params, 0), params[2:])), b""
        case Instruction.REG_WRITE if len(params) >= 3:
            servo.registered = (_word(params, 0), params[2:])
            result = Error2.NONE, b""
        case Instruction.ACTION if servo.registered is not None:
            result = _error(act(servo)), b""
        case Instruction.REBOOT:
            servo.restart(time_s)
            result = Error2.NONE, b""
        case Instruction.CLEAR if params == _CLEAR_TURNS:
            result = Error2.NONE, b""  # one turn has nothing to clear
        case _:
            result = Error2.INSTRUCTION, b""
    return result if level > READS_ONLY else None


def _word(params: bytes, at: int) -> int:
    return int.from_bytes(params[at : at + 2], "little")


def _error(refusal: Refusal | None) -> int:
    return Error2.NONE if refusal is None else _ERROR[refusal]


def _read(servo: Servo, read: _Read) -> tuple[int, bytes]:
    data = servo.read(read.address, read.size)
    return (_error(data), b"") if isinstance(data, Refusal) else (Error2.NONE, data)


def _reads(code: int, params: bytes) -> list[_Read]:
    if code in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        return [_Read(servo_id, _word(params, 0), _word(params, 2)) for servo_id in params[4:]]
    return [_Read(params[i], _word(params, i + 1), _word(params, i + 3)) for i in range(0, len(params) - 4, 5)]


def _bulk_write(params: bytes, servos: Sequence[Servo]) -> None:
    at = 0
    while at + 5 <= len(params):
        size = _word(params, at + 3)
        write_to(servos, params[at], _word(params, at + 1), params[at + 5 : at + 5 + size])
        at += 5 + size


def _chain(reads: list[_Read], servos: Sequence[Servo]) -> list[tuple[Servo, _Read]]:
    """Return the answering servos: each waits for the one before it, so a missing one silences the rest."""
    chain = []
    for read in reads:
        servo = find(servos, read.id)
        if servo is None or servo.table.get("status_return_level") == QUIET:
            break
        chain.append((servo, read))
    return chain


def _read_in_turn(reads: list[_Read], servos: Sequence[Servo]) -> list[Answer]:
    return [_status(servo, *_read(servo, read)) for servo, read in _chain(reads, servos)]


def _read_together(reads: list[_Read], servos: Sequence[Servo]) -> list[Answer]:
    chain = _chain(reads, servos)
    blocks = []
    for servo, read in chain:
        error, data = _read(servo, read)
        blocks.append(Block(servo.id, servo.error | error, data or bytes(read.size)))
    blocks += [Block(read.id, 0, bytes(read.size)) for read in reads[len(chain) :]]
    if not chain:
        return []
    delay_s = chain[0][0].return_delay_s
    return [Answer(tuple(servo.id for servo, _ in chain), fast_status(blocks, len(chain)), delay_s)]
