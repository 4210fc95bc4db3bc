"""A flight's record back into columns, events and what a replay needs."""

import json
import struct
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from companion.records.flight_record import FlightRecord, RecordedTick, RecordError
from companion.records.table import HealthEvent, RecordedEvent, Table

__all__ = ["FlightRecord", "HealthEvent", "RecordError", "RecordedEvent", "RecordedTick", "read_flight"]

MAGIC = b"\x89MCAP0\r\n"
META = "companion"
"""Name of the metadata record: `begin` and `start`, both JSON."""
_BROKEN = (McapError, EOFError, struct.error, ZstdError, ValueError, KeyError, IndexError, TypeError, RuntimeError)
"""What reading a file that was cut off, or is none, may raise."""


def read_flight(path: Path) -> FlightRecord:
    """The record of a flight, an MCAP file or an NPZ file of before; RecordError with one sentence where it is none."""
    try:
        with path.open("rb") as file:
            magic = file.read(len(MAGIC))
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error
    if magic == MAGIC:
        return _read_mcap(path)
    if magic[:2] == b"PK":
        return _read_npz(path)
    raise RecordError(f"{path}: no record of a flight: neither an MCAP file nor an NPZ file of `companion demo`")


def _read_npz(path: Path) -> FlightRecord:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            columns = {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise RecordError(f"{path}: a damaged NPZ file: {error}") from error
    if "time_s" not in columns or "phase" not in columns:
        raise RecordError(f"{path}: an NPZ file, but no record of a flight: it has no columns time_s and phase")
    return FlightRecord(path, columns)


def _read_mcap(path: Path) -> FlightRecord:
    table, metadata, truncated = Table(), _Metadata(), False
    with path.open("rb") as file:
        try:
            for record in StreamReader(file, record_size_limit=None).records:
                if isinstance(record, Channel):
                    table.topics[record.id] = record.topic
                elif isinstance(record, Message):
                    table.take(record)
                elif isinstance(record, Metadata) and record.name == META:
                    metadata.take(record)
        except _BROKEN:
            truncated = True
    if not table.ticks:
        raise RecordError(f"{path}: an MCAP file without a single tick of a flight")
    return FlightRecord(
        path, table.columns(), tuple(table.events), tuple(table.health), metadata.begin, metadata.start, truncated
    )


@dataclass
class _Metadata:
    begin: dict[str, Any] = field(default_factory=dict)
    start: dict[str, Any] = field(default_factory=dict)

    def take(self, record: Metadata) -> None:
        self.begin = self.begin | json.loads(record.metadata.get("begin", "{}"))
        self.start = self.start or json.loads(record.metadata.get("start", "{}"))
