"""Bytes of both DYNAMIXEL protocols, as the servos see them; pure.

Sources (ROBOTIS e-manual): https://emanual.robotis.com/docs/en/dxl/protocol1/,
https://emanual.robotis.com/docs/en/dxl/protocol2/, https://emanual.robotis.com/docs/en/dxl/crc/. Both kinds of servo
share one half-duplex line, so that both kinds of packet come out of one stream of bytes: `FF FF FD 00` opens one of
Protocol 2.0, `FF FF ID` one of 1.0, in which the IDs FD and FF do not exist.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag

BROADCAST_ID = 0xFE
MAX_PACKET_BYTES = 1024
"""A length beyond this is taken for garbage; what a servo really takes is less."""

_HEADER_1 = b"\xff\xff"
_HEADER_2 = b"\xff\xff\xfd\x00"
_STUFFED = (b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
_HEAD_1, _HEAD_2 = 4, 7
"""Bytes before those that the length counts."""


class Instruction(IntEnum):
    """Instructions of the host; 1.0 has ping to factory reset, sync write and bulk read."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class Error1(IntFlag):
    """Bits of the error byte of Protocol 1.0."""

    INPUT_VOLTAGE = 0x01
    ANGLE_LIMIT = 0x02
    OVERHEATING = 0x04
    RANGE = 0x08
    CHECKSUM = 0x10
    OVERLOAD = 0x20
    INSTRUCTION = 0x40


class Error2(IntEnum):
    """Numbers in the low seven bits of the error byte of Protocol 2.0."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT = 0x80
"""Top bit of the error byte of Protocol 2.0: see Hardware Error Status."""


@dataclass(frozen=True)
class Packet:
    """One packet off the wire: an instruction, or an answer when `code` says so."""

    protocol: int
    """1 or 2."""
    id: int
    code: int
    """The instruction; in an answer of 1.0 the error byte."""
    params: bytes
    """Without stuffing; in an answer of 2.0 the error byte comes first."""
    intact: bool = True
    """True if checksum or CRC is right."""
    wire_bytes: int = field(default=0, compare=False)
    """Number of bytes on the wire."""


@dataclass(frozen=True)
class Block:
    """One servo's part of the common answer to a fast read."""

    id: int
    error: int
    data: bytes


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC = _crc_table()


def crc16(data: bytes, crc: int = 0) -> int:
    """CRC-16 of Protocol 2.0: polynomial 0x8005, most significant bit first, from 0."""
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ _CRC[(crc >> 8) ^ byte]
    return crc


def checksum(data: bytes) -> int:
    """Checksum of Protocol 1.0 over ID, length, instruction or error, and parameters."""
    return ~sum(data) & 0xFF


def pack1(servo_id: int, code: int, params: bytes = b"") -> bytes:
    """Pack for Protocol 1.0; `code` is an instruction, or the error byte of an answer."""
    body = bytes([servo_id, len(params) + 2, code]) + params
    return _HEADER_1 + body + bytes([checksum(body)])


def pack2(servo_id: int, instruction: int, params: bytes = b"") -> bytes:
    """Pack for Protocol 2.0, stuffing and CRC included."""
    body = _stuff(bytes([instruction]) + params)
    return _with_crc(_HEADER_2 + bytes([servo_id]) + (len(body) + 2).to_bytes(2, "little") + body)


def status2(servo_id: int, error: int, params: bytes = b"") -> bytes:
    """Pack one servo's answer in Protocol 2.0."""
    return pack2(servo_id, Instruction.STATUS, bytes([error]) + params)


def fast_status(blocks: Sequence[Block], present: int | None = None) -> bytes:
    """Pack the common answer of several servos to a fast read: one head, then error, ID, data and CRC of each.

    Every CRC covers all bytes before it, and there is no stuffing. Each servo sends its own part when the one before
    has sent; after the first `present` of them the chain breaks, though the head still announces them all.
    """
    length = 1 + sum(4 + len(block.data) for block in blocks)
    out = _HEADER_2 + bytes([BROADCAST_ID]) + length.to_bytes(2, "little") + bytes([Instruction.STATUS])
    for block in blocks[:present]:
        out = _with_crc(out + bytes([block.error, block.id]) + block.data)
    return out if blocks[:present] else b""


def _with_crc(data: bytes) -> bytes:
    return data + crc16(data).to_bytes(2, "little")


def _stuff(body: bytes) -> bytes:
    return body.replace(*_STUFFED)


def _unstuff(body: bytes) -> bytes:
    return body.replace(_STUFFED[1], _STUFFED[0])


class Parser:
    """Takes bytes as they come and gives the packets that are complete; what is no packet is passed over."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Add bytes; return the packets that are complete."""
        self._buffer += data
        packets = []
        while (packet := self._next()) is not None:
            packets.append(packet)
        return packets

    def reset(self) -> None:
        """Forget an unfinished packet, as a servo does when the line falls silent in the middle of it."""
        self._buffer.clear()

    def _next(self) -> Packet | None:
        while True:
            self._drop_garbage()
            size = self._announced()
            if size == 0:
                del self._buffer[0]
            elif size is None or len(self._buffer) < size:
                return None
            else:
                raw = bytes(self._buffer[:size])
                del self._buffer[:size]
                return _packet2(raw) if raw.startswith(_HEADER_2) else _packet1(raw)

    def _drop_garbage(self) -> None:
        start = self._buffer.find(_HEADER_1)
        if start < 0:
            start = len(self._buffer) - self._buffer.endswith(b"\xff")
        del self._buffer[:start]

    def _announced(self) -> int | None:
        """Size of the packet that starts here; 0 when none can, None when too few bytes are there to say."""
        buffer = self._buffer
        if len(buffer) < _HEAD_1:
            return None
        if buffer[2] < 0xFD or buffer[2] == BROADCAST_ID:
            return _HEAD_1 + buffer[3] if buffer[3] >= 2 else 0
        if buffer[2:4] != _HEADER_2[2:]:
            return 0
        if len(buffer) < _HEAD_2:
            return None
        length = int.from_bytes(buffer[5:7], "little")
        return _HEAD_2 + length if 3 <= length <= MAX_PACKET_BYTES else 0


def _packet1(raw: bytes) -> Packet:
    return Packet(1, raw[2], raw[4], raw[5:-1], checksum(raw[2:-1]) == raw[-1], len(raw))


def _packet2(raw: bytes) -> Packet:
    body = _unstuff(raw[_HEAD_2:-2])
    intact = crc16(raw[:-2]) == int.from_bytes(raw[-2:], "little")
    return Packet(2, raw[4], body[0], body[1:], intact, len(raw))
