"""A flight's record back into columns, events and what a replay needs."""

import json
import math
import tokenize
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Channel, Header, McapRecord, Message, Metadata

from companion.records.errors import RecordError
from companion.records.flight_record import FlightRecord, RecordedTick
from companion.records.mcap_file import BROKEN, MAGIC, McapFile, cannot_read, check_readable
from companion.records.split.ground_signals import signals_at
from companion.records.table import GROUND, GROUND_TOPICS, HealthEvent, RecordedEvent, Table

__all__ = ["FlightRecord", "HealthEvent", "RecordError", "RecordedEvent", "RecordedTick", "read_flight"]

META = "companion"
"""Name of the metadata record: `begin` and `start`, both JSON."""
FLIGHT = "/flight"
"""The topic that every record has."""
_LARGEST_NPZ = 4_000_000_000
"""Bytes of all arrays, unpacked."""
_KINDS: dict[str, type | tuple[type, ...]] = {
    "unix_offset_s": (int, float), "vehicle": str, "config": dict, "controller": dict, "laws": dict, "versions": dict,
    "off": str,
}  # fmt: skip
"""Types of the service's messages; a value of another type was damaged."""


def read_flight(path: Path) -> FlightRecord:
    """Read the record of a flight, an MCAP file of the service or the demo, or an NPZ file of a simulation.

    Raises RecordError with one sentence where there is not a single tick of a flight in it. What is damaged or cut off
    is left out, see `FlightRecord.damage` and `truncated`.
    """
    check_readable(path)
    try:
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
        if magic == MAGIC:
            return _read_mcap(path)
        if magic[:2] == b"PK":
            return _read_npz(path)
    except OSError as error:
        raise cannot_read(path, error) from error
    if not magic:
        raise RecordError(f"{path}: an empty file: no record of a flight was written to it, it can be deleted")
    raise RecordError(
        f"{path}: no record of a flight: neither an MCAP file, as serve and demo write it, nor an NPZ file "
        "of simulate or dry-run"
    )


def _read_npz(path: Path) -> FlightRecord:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            size = sum(info.file_size for info in arrays.zip.infolist())
            if size > _LARGEST_NPZ:
                raise RecordError(f"{path}: an NPZ file that unpacks to {size / 1e9:.0f} GB: no record of a flight")
            columns = {name: arrays[name] for name in arrays.files}
    except (*BROKEN, zipfile.BadZipFile, zlib.error, tokenize.TokenError) as error:
        raise RecordError(f"{path}: a damaged NPZ file: {error}") from error
    if "time_s" not in columns or "phase" not in columns:
        raise RecordError(f"{path}: an NPZ file, but no record of a flight: it has no columns time_s and phase")
    return FlightRecord(path=path, columns=_checked(path, columns))


def _read_mcap(path: Path) -> FlightRecord:
    table, ground, metadata = Table(), Table(), _Metadata()
    with path.open("rb") as file:
        source = McapFile(file)
        for record in source:
            try:
                _take(record, table, ground, metadata)
            except BROKEN as error:
                source.note(source.tell(), f"a message of another program ({type(error).__name__})")
    if not table.ticks:
        raise _without_a_tick(path, source, table, metadata)
    try:
        columns = _checked(path, table.columns())
    except BROKEN as error:
        raise RecordError(f"{path}: its messages are not those of a record: {error}") from error
    of_ground = _ground_record(path, ground, metadata, source)
    return FlightRecord(
        path=path,
        columns=columns if of_ground is None else columns | signals_at(columns, of_ground.columns),
        ground=of_ground,
        events=tuple(table.events),
        health=tuple(table.health),
        metadata=metadata.begin,
        start=metadata.start,
        truncated=source.truncated,
        damage=_damage(source),
    )


def _ground_record(path: Path, table: Table, metadata: "_Metadata", source: McapFile) -> FlightRecord | None:
    """Return the ground's side of a merged file; None in any other, and where it is damaged."""
    if not table.ticks:
        return None
    try:
        columns = _checked(path, table.columns())
    except (RecordError, *BROKEN):
        source.damage.append("no readable cycle of the ground")
        return None
    return FlightRecord(path=path, columns=columns, events=tuple(table.events), metadata=metadata.ground)


def _take(record: McapRecord, table: Table, ground: Table, metadata: "_Metadata") -> None:
    if isinstance(record, Channel) and record.topic.startswith(GROUND_TOPICS):
        ground.topics[record.id] = f"/{record.topic.removeprefix(GROUND_TOPICS)}"
    elif isinstance(record, Channel):
        table.topics[record.id] = record.topic
    elif isinstance(record, Message):
        (ground if record.channel_id in ground.topics else table).take(record)
    elif isinstance(record, Metadata) and record.name == META:
        metadata.take(record)
    elif isinstance(record, Header):
        metadata.library = record.library


def _without_a_tick(path: Path, source: McapFile, table: Table, metadata: "_Metadata") -> RecordError:
    topics = sorted(set(table.topics.values()))
    if source.damage:
        return RecordError(
            f"{path}: a damaged MCAP file without a single readable tick: {_damage(source)}; look with `mcap recover` "
            "(https://mcap.dev/guides/cli) for what is left in it"
        )
    if topics and FLIGHT not in topics:
        by = f" of another program, {metadata.library!r}" if metadata.library else ""
        return RecordError(
            f"{path}: an MCAP file{by}, without a single tick of a flight: its topics are {', '.join(topics[:4])}; "
            "Foxglove opens it"
        )
    why = ": it was cut off before the first one" if source.truncated else ""
    return RecordError(f"{path}: an MCAP file without a single tick of a flight{why}")


def _damage(source: McapFile) -> str:
    more = len(source.damage) - 1
    return source.damage[0] + (f", and {more} more" if more > 0 else "") if source.damage else ""


def _checked(path: Path, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns without rows that have no time; RecordError where they are no table, or an empty one."""
    time_s = columns.get("time_s")
    if time_s is None or time_s.ndim != 1 or time_s.dtype.kind != "f" or "phase" not in columns:
        raise RecordError(f"{path}: no record of a flight: it has no columns time_s and phase of one row a tick")
    odd = [name for name, column in columns.items() if column.ndim == 0 or len(column) != len(time_s)]
    if odd:
        raise RecordError(f"{path}: no record of a flight: column {odd[0]} has not one row a tick")
    known = np.isfinite(time_s)
    if not known.any():
        raise RecordError(f"{path}: no record of a flight: it has not a single tick with a time")
    return columns if known.all() else {name: column[known] for name, column in columns.items()}


@dataclass
class _Metadata:
    begin: dict[str, Any] = field(default_factory=dict)
    start: dict[str, Any] = field(default_factory=dict)
    ground: dict[str, Any] = field(default_factory=dict)
    """Metadata of the ground's side of a merged file."""
    library: str = ""

    def take(self, record: Metadata) -> None:
        begin = json.loads(record.metadata.get("begin", "{}"))
        self.begin = self.begin | {name: value for name, value in begin.items() if _is_told(name, value)}
        start = json.loads(record.metadata.get("start", "{}"))
        self.start = self.start or (start if isinstance(start, dict) else {})
        ground = json.loads(record.metadata.get(GROUND, "{}"))
        self.ground |= ground if isinstance(ground, dict) else {}


def _is_told(name: str, value: object) -> bool:
    if not isinstance(value, _KINDS.get(name, object)):
        return False
    return name != "unix_offset_s" or math.isfinite(float(value))  # type: ignore[arg-type]
