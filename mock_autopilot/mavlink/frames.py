"""MAVLink frames out of one datagram. Nothing is carried over: garbage must not swallow the next datagram."""

import struct
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

V1, V2 = 0xFE, 0xFD
V1_OVERHEAD, V2_OVERHEAD, SIGNATURE = 8, 12, 13
SIGNED = 0x01


def messages_in(payload: bytes, codec: mavlink.MAVLink) -> list[Any]:
    """Return every intact message; bytes that are no frame, or have a wrong checksum, are skipped."""
    found = []
    start = 0
    while start < len(payload):
        length = _frame_length(payload, start)
        message = _decoded(payload[start : start + length], codec) if length else None
        if message is not None:
            found.append(message)
        start += length if message is not None else 1
    return found


def _frame_length(payload: bytes, start: int) -> int:
    """Return the length of the frame that may begin here, 0 when none can."""
    marker, rest = payload[start], len(payload) - start
    if marker not in {V1, V2} or rest < V1_OVERHEAD:
        return 0
    length = payload[start + 1] + (V1_OVERHEAD if marker == V1 else V2_OVERHEAD)
    if marker == V2 and payload[start + 2] & SIGNED:
        length += SIGNATURE
    return length if length <= rest else 0


def _decoded(frame: bytes, codec: mavlink.MAVLink) -> Any | None:
    try:
        message = codec.decode(bytearray(frame))
    except (mavlink.MAVError, struct.error):
        return None
    return None if message.get_type().startswith(("UNKNOWN", "BAD_DATA")) else message
