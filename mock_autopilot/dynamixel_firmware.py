"""What the servos do with a packet, and what they answer; pure.

Sources: https://emanual.robotis.com/docs/en/dxl/protocol1/ and https://emanual.robotis.com/docs/en/dxl/protocol2/,
"Instruction Details". Factory Reset answers with an instruction error: nobody resets a vehicle's servos over the bus.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from mock_autopilot.dynamixel_memory import Refusal
from mock_autopilot.dynamixel_packets import (
    BROADCAST_ID,
    Block,
    Error1,
    Error2,
    Instruction,
    Packet,
    fast_status,
    pack1,
    status2,
)
from mock_autopilot.servo import Servo

_ERROR2 = {
    Refusal.NO_SUCH_ADDRESS: Error2.ACCESS,
    Refusal.READ_ONLY: Error2.ACCESS,
    Refusal.LOCKED: Error2.ACCESS,
    Refusal.CUT_SHORT: Error2.DATA_LENGTH,
    Refusal.OUT_OF_RANGE: Error2.DATA_RANGE,
    Refusal.OVER_LIMIT: Error2.DATA_LIMIT,
    Refusal.SHUT_DOWN: Error2.RESULT_FAIL,
}
_QUIET, _READS_ONLY = 0, 1
"""Status Return Level: answers to pings alone; to reads, too."""
_CLEAR_TURNS = bytes([0x01, 0x44, 0x58, 0x4C, 0x22])


@dataclass(frozen=True)
class Answer:
    """Bytes that servos put on the wire after an instruction, in order."""

    ids: tuple[int, ...]
    """Whose; several for the common answer to a fast read."""
    data: bytes
    return_delay_s: float
    """From the end of what was on the wire before, as the Return Delay Time says."""
    late_s: float = 0.0
    """A fault's delay."""


@dataclass(frozen=True)
class _Read:
    """One servo's part of a sync or bulk read."""

    id: int
    address: int
    size: int


def answer(packet: Packet, servos: Sequence[Servo], time_s: float) -> list[Answer]:
    """Let the servos that hear the packet act on it. `servos` are those that can hear now, in the order of the bus."""
    mine = [servo for servo in servos if servo.model.protocol == packet.protocol]
    for servo in mine:
        servo.heard_s = time_s
    if packet.protocol == 1:
        return _answer1(packet, mine)
    return _answer2(packet, mine, time_s)


def _answer1(packet: Packet, servos: list[Servo]) -> list[Answer]:
    if packet.code == Instruction.BULK_READ and packet.intact:
        return _bulk_read1(packet.params, servos)
    if packet.code == Instruction.SYNC_WRITE and packet.intact:
        _sync_write(packet.params, 1, servos)
        return []
    answers = []
    for servo in servos:
        if packet.id in (servo.id, BROADCAST_ID):
            done = _do1(packet, servo)
            if done is not None and packet.id != BROADCAST_ID:
                answers.append(_status1(servo, *done))
    return answers


def _status1(servo: Servo, error: int, data: bytes) -> Answer:
    return Answer((servo.id,), pack1(servo.id, servo.error | error, data), servo.return_delay_s)


def _do1(packet: Packet, servo: Servo) -> tuple[int, bytes] | None:
    """Error bits and data of the answer; None for no answer."""
    if not packet.intact:
        return Error1.CHECKSUM, b""
    level, params = servo.table.get("status_return_level"), packet.params
    match packet.code:
        case Instruction.PING:
            return 0, b""
        case Instruction.READ if len(params) == 2:
            data = servo.read(params[0], params[1])
            result = (Error1.RANGE, b"") if isinstance(data, Refusal) else (0, data)
            return result if level >= _READS_ONLY else None
        case Instruction.WRITE if len(params) >= 2:
            result = _error1(servo.write(params[0], params[1:])), b""
        case Instruction.REG_WRITE if len(params) >= 2:
            servo.registered = (params[0], params[1:])
            result = 0, b""
        case Instruction.ACTION if servo.registered is not None:
            result = _error1(_act(servo)), b""
        case _:
            result = Error1.INSTRUCTION, b""
    return result if level > _READS_ONLY else None


def _error1(refusal: Refusal | None) -> int:
    if refusal is None:
        return 0
    return Error1.ANGLE_LIMIT if refusal is Refusal.OVER_LIMIT else Error1.RANGE


def _act(servo: Servo) -> Refusal | None:
    address, data = servo.registered or (0, b"")
    servo.registered = None
    return servo.write(address, data)


def _bulk_read1(params: bytes, servos: list[Servo]) -> list[Answer]:
    """Each servo waits for the one before it in the list: a missing one silences those behind it."""
    answers = []
    for size, servo_id, address in zip(params[1::3], params[2::3], params[3::3], strict=False):
        servo = _find(servos, servo_id)
        if servo is None or servo.table.get("status_return_level") == _QUIET:
            break
        data = servo.read(address, size)
        answers.append(_status1(servo, *((Error1.RANGE, b"") if isinstance(data, Refusal) else (0, data))))
    return answers


def _find(servos: list[Servo], servo_id: int) -> Servo | None:
    return next((servo for servo in servos if servo.id == servo_id), None)


def _sync_write(params: bytes, width: int, servos: list[Servo]) -> None:
    """Write to each servo named; `width` is the bytes of address and of size. Nobody answers."""
    if len(params) < 2 * width:
        return
    address, size = (int.from_bytes(params[i : i + width], "little") for i in (0, width))
    for at in range(2 * width, len(params) - size, size + 1):
        servo = _find(servos, params[at])
        if servo is not None:
            servo.write(address, params[at + 1 : at + 1 + size])


def _answer2(packet: Packet, servos: list[Servo], time_s: float) -> list[Answer]:
    params, code = packet.params, packet.code if packet.intact else Instruction.STATUS
    match code:
        case Instruction.SYNC_READ | Instruction.BULK_READ:
            return _read_in_turn(_reads(code, params), servos)
        case Instruction.FAST_SYNC_READ | Instruction.FAST_BULK_READ:
            return _read_together(_reads(code, params), servos)
        case Instruction.SYNC_WRITE:
            _sync_write(params, 2, servos)
            return []
        case Instruction.BULK_WRITE:
            _bulk_write(params, servos)
            return []
    answers = []
    for servo in sorted(servos, key=lambda servo: servo.id):
        if packet.id in (servo.id, BROADCAST_ID):
            done = _do2(packet, servo, time_s)
            if done is not None and (packet.id != BROADCAST_ID or packet.code == Instruction.PING):
                answers.append(_status2(servo, *done))
    return answers


def _status2(servo: Servo, error: int, data: bytes) -> Answer:
    return Answer((servo.id,), status2(servo.id, servo.error | error, data), servo.return_delay_s)


def _do2(packet: Packet, servo: Servo, time_s: float) -> tuple[int, bytes] | None:
    """Error number and data of the answer; None for no answer."""
    if not packet.intact:
        return Error2.CRC, b""
    level, params = servo.table.get("status_return_level"), packet.params
    match packet.code:
        case Instruction.PING:
            return Error2.NONE, servo.model.number.to_bytes(2, "little") + bytes([servo.table.get("firmware_version")])
        case Instruction.READ if len(params) == 4:
            return _read2(servo, _Read(servo.id, _word(params, 0), _word(params, 2))) if level >= _READS_ONLY else None
        case Instruction.WRITE if len(params) >= 3:
            result = _error2(servo.write(_word(params, 0), params[2:])), b""
        case Instruction.REG_WRITE if len(params) >= 3:
            servo.registered = (_word(params, 0), params[2:])
            result = Error2.NONE, b""
        case Instruction.ACTION if servo.registered is not None:
            result = _error2(_act(servo)), b""
        case Instruction.REBOOT:
            servo.restart(time_s)
            result = Error2.NONE, b""
        case Instruction.CLEAR if params == _CLEAR_TURNS:
            result = Error2.NONE, b""  # one turn has nothing to clear
        case _:
            result = Error2.INSTRUCTION, b""
    return result if level > _READS_ONLY else None


def _word(params: bytes, at: int) -> int:
    return int.from_bytes(params[at : at + 2], "little")


def _error2(refusal: Refusal | None) -> int:
    return Error2.NONE if refusal is None else _ERROR2[refusal]


def _read2(servo: Servo, read: _Read) -> tuple[int, bytes]:
    data = servo.read(read.address, read.size)
    return (_error2(data), b"") if isinstance(data, Refusal) else (Error2.NONE, data)


def _reads(code: int, params: bytes) -> list[_Read]:
    if code in (Instruction.SYNC_READ, Instruction.FAST_SYNC_READ):
        return [_Read(servo_id, _word(params, 0), _word(params, 2)) for servo_id in params[4:]]
    return [_Read(params[i], _word(params, i + 1), _word(params, i + 3)) for i in range(0, len(params) - 4, 5)]


def _bulk_write(params: bytes, servos: list[Servo]) -> None:
    at = 0
    while at + 5 <= len(params):
        size = _word(params, at + 3)
        servo = _find(servos, params[at])
        if servo is not None:
            servo.write(_word(params, at + 1), params[at + 5 : at + 5 + size])
        at += 5 + size


def _chain(reads: list[_Read], servos: list[Servo]) -> list[tuple[Servo, _Read]]:
    """Those that answer: each waits for the one before it, so that a missing one silences those behind it."""
    chain = []
    for read in reads:
        servo = _find(servos, read.id)
        if servo is None or servo.table.get("status_return_level") == _QUIET:
            break
        chain.append((servo, read))
    return chain


def _read_in_turn(reads: list[_Read], servos: list[Servo]) -> list[Answer]:
    return [_status2(servo, *_read2(servo, read)) for servo, read in _chain(reads, servos)]


def _read_together(reads: list[_Read], servos: list[Servo]) -> list[Answer]:
    chain = _chain(reads, servos)
    blocks = []
    for servo, read in chain:
        error, data = _read2(servo, read)
        blocks.append(Block(servo.id, servo.error | error, data or bytes(read.size)))
    blocks += [Block(read.id, 0, bytes(read.size)) for read in reads[len(chain) :]]
    if not chain:
        return []
    delay_s = chain[0][0].return_delay_s
    return [Answer(tuple(servo.id for servo, _ in chain), fast_status(blocks, len(chain)), delay_s)]
