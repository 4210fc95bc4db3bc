"""Telemetry logs: eight bytes of big-endian microseconds, then one MAVLink 2 frame, again and again."""

import gzip
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

STAMP_BYTES = 8
V2, HEAD, CHECKSUM, SIGNATURE = 0xFD, 10, 2, 13
SIGNED = 0x01


class TlogError(ValueError):
    """The file is no telemetry log; the message is one sentence for a person."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One frame on the wire and when it was there (s, any epoch)."""

    at_s: float
    raw: bytes

    @property
    def system(self) -> int:
        return self.raw[5]

    @property
    def component(self) -> int:
        return self.raw[6]

    @property
    def id(self) -> int:
        return int.from_bytes(self.raw[7:10], "little")


def read(path: Path) -> list[Frame]:
    """Read a log, gzipped or not; TlogError when it is none."""
    try:
        data = path.read_bytes()
        data = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
    except (OSError, EOFError) as error:
        raise TlogError(f"cannot read {path}: {error}") from None
    frames = sorted(_frames(data), key=lambda frame: frame.at_s)
    if not frames:
        raise TlogError(f"{path} holds no MAVLink 2 frames: is it a telemetry log?")
    return frames


def _frames(data: bytes) -> Iterator[Frame]:
    """Step over what is not a frame, one byte at a time."""
    start = 0
    while start + STAMP_BYTES + HEAD + CHECKSUM <= len(data):
        head = start + STAMP_BYTES
        signature = SIGNATURE if data[head + 2] & SIGNED else 0
        end = head + HEAD + data[head + 1] + CHECKSUM + signature
        if data[head] != V2 or end > len(data):
            start += 1
            continue
        (micros,) = struct.unpack_from(">Q", data, start)
        yield Frame(at_s=micros / 1e6, raw=data[head:end])
        start = end


class Decoder:
    """Frames to messages; those that pymavlink does not know give None."""

    def __init__(self) -> None:
        self._codec = mavlink.MAVLink(None)

    def message(self, frame: Frame) -> Any | None:
        """Decode one frame; return None for a message that pymavlink does not know."""
        if frame.id not in mavlink.mavlink_map:
            return None
        try:
            return self._codec.decode(bytearray(frame.raw))
        except (mavlink.MAVError, struct.error):
            return None
