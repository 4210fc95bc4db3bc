"""The message that crosses the link: number, time and padding, with a keyed tag; 23 bytes, and every third 45."""

import hashlib
import struct

_HEAD = struct.Struct("<Id")
_TAG_BYTES = 8
_KEY = b"a key of the benchmark"
BEAT_BYTES, EVENT_BYTES = 23, 45
PERIOD_S = 0.03
"""33 messages a second."""


def pack(number: int, sent_s: float) -> bytes:
    """Return message `number`, sent at `sent_s` of the machine's monotonic clock."""
    size = BEAT_BYTES if number % 3 else EVENT_BYTES
    body = _HEAD.pack(number, sent_s).ljust(size - _TAG_BYTES, b"\0")
    return body + _tag(body)


def unpack(message: bytes) -> tuple[int, float] | None:
    """Return number and time of a message; None when its tag is wrong."""
    body, tag = message[:-_TAG_BYTES], message[-_TAG_BYTES:]
    if len(message) < _HEAD.size + _TAG_BYTES or tag != _tag(body):
        return None
    number, sent_s = _HEAD.unpack_from(body)
    return int(number), float(sent_s)


def _tag(body: bytes) -> bytes:
    return hashlib.blake2b(body, digest_size=_TAG_BYTES, key=_KEY).digest()
