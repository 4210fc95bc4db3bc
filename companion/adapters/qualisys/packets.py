"""Checks on packets from QTM before the SDK parses them; pure.

The SDK trusts sizes and counts: a size of zero or a count of four billion keeps it busy for ever.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from qtm_rt.packet import QRTComponentType

from companion.core.types import Array, Vec3

HEADER = struct.Struct("<II")
ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT = 0, 1, 2, 3, 4, 6
MAX_PACKET_BYTES: Mapping[int, int] = MappingProxyType(
    {ERROR: 64_000, COMMAND: 64_000, XML: 8_000_000, DATA: 256_000, NO_MORE_DATA: HEADER.size, EVENT: HEADER.size + 1}
)
"""By type. A rigid body needs 52 bytes of a frame, and some kilobytes of the settings."""
_MAX_UNKNOWN_BYTES = 64_000
MAX_TALK = 500
"""Packets in one read that are no frames: events and answers are few, and each is logged while the loop waits."""
MAX_COMPONENTS = 32
"""The protocol knows 19 kinds of data, each once in a packet."""
_COMPONENT_COUNT = struct.Struct("<I")
_COMPONENT_COUNT_AT = HEADER.size + 12
_BODY_COUNT = struct.Struct("<ihh")
_BODY = struct.Struct("<13f")
"""Position (mm), rotation matrix column by column, residual (mm)."""
_PLACE = struct.Struct("<3f")
"""The position alone."""


class MalformedError(ValueError):
    """The bytes are no packet of QTM's; the text ends the sentence 'QTM at ... sent ...'."""


@dataclass(frozen=True)
class BodyPose:
    """One body as the wire has it, in our units; NaN while it is not tracked."""

    position_w_m: Array
    rotation_w_b: Array
    residual_m: float


def split_packets(buffer: bytearray) -> list[bytes]:
    """Remove whole packets, with header and unchecked, from the front of `buffer`; MalformedError if there are none."""
    packets, talk = list[bytes](), 0
    while len(buffer) >= HEADER.size:
        size, kind = HEADER.unpack_from(buffer)
        if not HEADER.size <= size <= MAX_PACKET_BYTES.get(kind, _MAX_UNKNOWN_BYTES):
            raise MalformedError(f"a packet of {size} bytes")
        if len(buffer) < size:
            break
        packets.append(bytes(buffer[:size]))
        del buffer[:size]
        talk += kind != DATA
        if talk > MAX_TALK:
            raise MalformedError(f"more than {MAX_TALK} packets at once that are no frames")
    return packets


def check_packet(packet: bytes) -> None:
    """Refuse (MalformedError) a whole packet on which the SDK would fail or never end."""
    size, kind = HEADER.unpack_from(packet)
    if size != len(packet):
        raise MalformedError(f"{len(packet)} bytes that say they are {size}")
    if kind != DATA:
        return
    if size < _COMPONENT_COUNT_AT + 4:
        raise MalformedError(f"a data packet of {size} bytes")
    (count,) = _COMPONENT_COUNT.unpack_from(packet, _COMPONENT_COUNT_AT)
    if count > MAX_COMPONENTS:
        raise MalformedError(f"a data packet of {count} components")


def body_count(packet: Any) -> int:
    """Return how many bodies a QRTPacket holds as 6dres; 0 without that component.

    Raises MalformedError when they are cut off. Without "Calculate 6DOF" among QTM's real-time actions there are none.
    """
    position = packet.components.get(QRTComponentType.Component6dRes)
    if position is None:
        return 0
    try:
        count, _, _ = _BODY_COUNT.unpack_from(packet.data, position)
    except struct.error as error:
        raise MalformedError("a frame that ends too early") from error
    if not 0 <= count * _BODY.size <= len(packet.data) - position - _BODY_COUNT.size:
        raise MalformedError("a frame that ends too early")
    return int(count)


def body_pose(packet: Any, index: int) -> BodyPose:
    """Return body number `index`, below `body_count`, of a QRTPacket."""
    position = packet.components[QRTComponentType.Component6dRes]
    values = _BODY.unpack_from(packet.data, position + _BODY_COUNT.size + index * _BODY.size)
    pose = np.array(values[:12])
    return BodyPose(pose[:3] * 1e-3, pose[3:].reshape(3, 3).T, values[12] * 1e-3)


def body_position_w_m(packet: Any, index: int) -> Vec3 | None:
    """Return the position (m, W) of body number `index`, below `body_count`; None while it is not tracked."""
    at = packet.components[QRTComponentType.Component6dRes] + _BODY_COUNT.size + index * _BODY.size
    x, y, z = _PLACE.unpack_from(packet.data, at)
    return (x * 1e-3, y * 1e-3, z * 1e-3) if math.isfinite(x + y + z) else None
