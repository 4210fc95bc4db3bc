"""What a record is of, without reading all of it."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from zstandard import ZstdError

from companion.records.read import FlightRecord, RecordError, read_flight


@dataclass(frozen=True)
class Glance:
    """A line of a list of flights."""

    path: Path
    begin_s: float
    """Unix time; NaN where the record does not say."""
    length_s: float
    law: str
    ended: str
    """Phase, and the reason if there is one."""
    size_mb: float
    truncated: bool


def glance(path: Path) -> Glance:
    """The record's line; RecordError where it is no record."""
    try:
        return _at_its_ends(path) or _of(read_flight(path))
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error


def _at_its_ends(path: Path) -> Glance | None:
    """From the summary and the last tick; None where the file has no summary."""
    with path.open("rb") as file:
        try:
            reader = make_reader(file)
            summary = reader.get_summary()
            if summary is None or summary.statistics is None:
                return None
            *_, last = next(reader.iter_messages(topics=["/flight"], reverse=True))
            said = json.loads(last.data)
        except (McapError, EOFError, StopIteration, ValueError, struct.error, ZstdError, KeyError):
            return None
    times = summary.statistics
    return Glance(
        path,
        1e-9 * times.message_start_time,
        1e-9 * (times.message_end_time - times.message_start_time),
        said["law_name"],
        _ended(said["phase"], said["reason"]),
        1e-6 * path.stat().st_size,
        truncated=False,
    )


def _of(record: FlightRecord) -> Glance:
    columns = record.columns
    times_s, nothing = columns["time_s"], np.array([""])
    return Glance(
        record.path,
        float(times_s[0]) + record.unix_offset_s if record.unix_offset_s else float("nan"),
        float(times_s[-1] - times_s[0]),
        str(columns.get("law_name", nothing)[-1]),
        _ended(str(columns["phase"][-1]), str(columns.get("reason", nothing)[-1])),
        1e-6 * record.path.stat().st_size,
        record.truncated,
    )


def _ended(phase: str, reason: str) -> str:
    return f"{phase}: {reason}" if reason else phase
