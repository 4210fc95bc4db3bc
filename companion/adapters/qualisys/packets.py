"""What bytes from QTM must look like before anything is done with them; pure.

The SDK trusts sizes and counts: a size of zero or a count of four billion keeps it busy for ever.
"""

import struct
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from qtm_rt.packet import QRTComponentType

from companion.types import Array

HEADER = struct.Struct("<II")
DATA = 3
MAX_PACKET_BYTES = 16_000_000
"""Far above any settings document or frame."""
MAX_TALK = 500
"""Packets in one read that are no frames: events and answers are few, and each is logged while the loop waits."""
MAX_COMPONENTS = 32
"""The protocol knows 19 kinds of data, each once in a packet."""
_COMPONENT_COUNT = struct.Struct("<I")
_COMPONENT_COUNT_AT = HEADER.size + 12
_BODY_COUNT = struct.Struct("<ihh")
_BODY = struct.Struct("<13f")
"""Position (mm), rotation matrix column by column, residual (mm)."""


class MalformedError(ValueError):
    """The bytes are no packet of QTM's; the text ends the sentence 'QTM at ... sent ...'."""


@dataclass(frozen=True)
class BodyPose:
    """One body as the wire has it, in our units; NaN while it is not tracked."""

    position_w_m: Array
    rotation_w_b: Array
    residual_m: float


def split_packets(buffer: bytearray) -> list[bytes]:
    """Remove the whole packets (with header) from the front of `buffer`; MalformedError when there can be none.

    What is in them is not looked at: `check_packet` does.
    """
    packets, talk = list[bytes](), 0
    while len(buffer) >= HEADER.size:
        size, kind = HEADER.unpack_from(buffer)
        if not HEADER.size <= size <= MAX_PACKET_BYTES:
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


def body_pose(packet: Any, index: int) -> BodyPose:
    """Body number `index` of a QRTPacket with the component 6dres; MalformedError when it is not in there."""
    position = packet.components.get(QRTComponentType.Component6dRes)
    if position is None:
        raise MalformedError("a frame without the component 6dres")
    try:
        count, _, _ = _BODY_COUNT.unpack_from(packet.data, position)
        if index >= count:
            raise MalformedError(f"a frame of {count} bodies where ours is number {index + 1}")
        values = _BODY.unpack_from(packet.data, position + _BODY_COUNT.size + index * _BODY.size)
    except struct.error as error:
        raise MalformedError("a frame that ends too early") from error
    pose = np.array(values[:12])
    return BodyPose(pose[:3] * 1e-3, pose[3:].reshape(3, 3).T, values[12] * 1e-3)


def body_names(xml: Any) -> list[str]:
    """Names of the rigid bodies in the answer to `getparameters 6d`, in the order of the data; MalformedError."""
    if not isinstance(xml, bytes):  # the SDK takes whatever packet comes next for the answer
        raise MalformedError("a frame where its settings were asked for")
    try:
        root = ElementTree.fromstring(xml)  # noqa: S314 - expat refuses entity bombs since 2.4.1
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the latter two for its encoding
        raise MalformedError(f"settings that are no XML ({error})") from error
    return [(body.findtext("Name") or "").strip() for body in root.findall("The_6D/Body")]
