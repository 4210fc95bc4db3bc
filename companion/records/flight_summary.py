"""One-line summary of each flight of a folder, without reading it whole; numpy only for files without a summary."""

import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Message, Metadata, MetadataIndex, Statistics

from companion.records.mcap_file import (
    BROKEN,
    BoundedFile,
    cannot_read,
    check_readable,
    content,
    places,
    stream_at,
)

_FLIGHT = "/flight"
_META = "companion"
_CHANNEL, _LENGTH = struct.Struct("<H"), struct.Struct("<Q")
"""First bytes of a message; and the last ones before it."""


@dataclass(frozen=True, kw_only=True)
class FlightSummary:
    """Summary of one flight, a line of the list."""

    path: Path
    begin_s: float = math.nan
    """Unix time; NaN where the record does not say."""
    length_s: float = math.nan
    law: str = ""
    """All that flew, in their order, with commas between."""
    ended: str = ""
    """Phase, and the reason if there is one."""
    size_mb: float
    truncated: bool = False
    unreadable: str = ""
    """Why it is no record, in a sentence; then there is nothing else but its size."""


def summarize_flight(path: Path) -> FlightSummary:
    """Return the record's line; RecordError where it is no record."""
    check_readable(path)
    try:
        return _at_its_ends(path) or _of_all(path)
    except OSError as error:
        raise cannot_read(path, error) from error


def unreadable(path: Path, why: str) -> FlightSummary:
    """Return the line of a file that is no record."""
    try:
        size_mb = 1e-6 * path.stat().st_size
    except OSError:
        size_mb = 0.0
    return FlightSummary(path=path, size_mb=size_mb, unreadable=why)


def _at_its_ends(path: Path) -> FlightSummary | None:
    with path.open("rb") as opened:
        file = BoundedFile(opened)
        try:
            summary = file.summary()
            times = Statistics.read(stream_at(summary, places(summary, Opcode.STATISTICS)[0]))
            said = json.loads(_last_tick(file, summary))
            return FlightSummary(
                path=path,
                begin_s=1e-9 * times.message_start_time,
                length_s=1e-9 * (times.message_end_time - times.message_start_time),
                law=_laws(file, summary, str(said["law_name"])),
                ended=ended(str(said["phase"]), str(said["reason"])),
                size_mb=1e-6 * file.size,
            )
        except (*BROKEN, StopIteration):
            return None


def _last_tick(file: BoundedFile, summary: bytes) -> bytes:
    """Return the flight's last message; StopIteration or one of BROKEN where there is none."""
    channels = [Channel.read(stream_at(summary, at)) for at in places(summary, Opcode.CHANNEL)]
    flights = {channel.id for channel in channels if channel.topic == _FLIGHT}
    indexes = (ChunkIndex.read(stream_at(summary, at)) for at in reversed(places(summary, Opcode.CHUNK_INDEX)))
    chunk = next(index for index in indexes if not flights.isdisjoint(index.message_index_offsets))
    data = content(file.chunk(chunk.chunk_start_offset))
    at = next(at for at in reversed(places(data, Opcode.MESSAGE)) if _CHANNEL.unpack_from(data, at)[0] in flights)
    (length,) = _LENGTH.unpack_from(data, at - _LENGTH.size)
    message: bytes = Message.read(stream_at(data, at), length).data
    return message


def _laws(file: BoundedFile, summary: bytes, last_law: str) -> str:
    """Return all that the writer noted at the end; the last one in a record of an older version."""
    indexes = [MetadataIndex.read(stream_at(summary, at)) for at in places(summary, Opcode.METADATA_INDEX)]
    offsets = [index.offset for index in indexes if index.name == _META]
    if not offsets:
        return last_law
    file.seek(max(offsets))
    last = next(file.reader(skip_magic=True))
    noted: Any = json.loads(last.metadata.get("end", "{}")) if isinstance(last, Metadata) else {}
    return ", ".join(map(str, noted["laws"])) if "laws" in noted else last_law


def _of_all(path: Path) -> FlightSummary:
    from companion.records.read import read_flight  # noqa: PLC0415 - a list of whole flights does without numpy

    record = read_flight(path)
    columns = record.columns
    times_s, empty = columns["time_s"], [""]
    return FlightSummary(
        path=path,
        begin_s=float(times_s[0]) + record.unix_offset_s if record.unix_offset_s else math.nan,
        length_s=float(times_s[-1] - times_s[0]),
        law=", ".join(record.laws),
        ended=ended(str(columns["phase"][-1]), str(columns.get("reason", empty)[-1])),
        size_mb=1e-6 * path.stat().st_size,
        truncated=record.truncated,
    )


def ended(phase: str, reason: str) -> str:
    """Return phase and reason in a line."""
    return f"{phase}: {reason}" if reason else phase
