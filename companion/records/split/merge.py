"""Merge of a vehicle's record and that of its law on the ground into one file, on the vehicle's clock."""

import heapq
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import Writer

from companion.records.channels import META
from companion.records.errors import RecordError
from companion.records.flight_record import FlightRecord
from companion.records.mcap_file import McapFile
from companion.records.read import read_flight
from companion.records.table import GROUND, GROUND_TOPICS

_LEFT_OUT = frozenset({"/autopilot", "/tf", "/scene", "/log"})
"""Topics of the ground that say nothing, or draw the vehicle a second time."""
_TIMES = re.compile(rb'"(time_s|sent_s|frame_received_s|vehicle_time_s|estimate_clock_offset_s)":([-+.0-9eE]+)')
"""Times on the ground's clock; the last one is added to a frame's stamp to give one."""
_APART_S = 1.0
"""Largest gap between two records of one flight."""


@dataclass(frozen=True, kw_only=True)
class Merged:
    """Result of a merge."""

    session: int
    offset_s: float
    """Vehicle's clock less the ground's."""
    ground_messages: int


def merge(vehicle: Path, ground: Path, into: Path) -> Merged:
    """Write one file with both records; RecordError where they are not the two sides of one flight.

    The ground's topics begin with GROUND_TOPICS, and its times are converted by the clock offset that it measured.
    """
    ours, theirs = read_flight(vehicle), read_flight(ground)
    session, offset_s = joined(ours, theirs)
    shift_s = offset_s + ours.unix_offset_s - theirs.unix_offset_s
    sources = _Source(vehicle), _Source(ground, _Shift(offset_s, round(1e9 * shift_s)))
    of_ground = 0
    with into.open("wb") as file:
        writer = Writer(file)
        writer.start(library="dauam-companion")
        copy = _Copy(writer)
        both = (source.messages(side) for side, source in enumerate(sources))
        for _, side, message in heapq.merge(*both, key=lambda one: one[:2]):
            copy.message(message)
            of_ground += side
        writer.add_metadata(META, {GROUND: json.dumps(theirs.metadata | {"clock_offset_s": offset_s})})
        for one in sources[0].metadata:  # the list of flights reads the last one
            writer.add_metadata(META, one)
        writer.finish()  # type: ignore[no-untyped-call]
    return Merged(session=session, offset_s=offset_s, ground_messages=of_ground)


def joined(vehicle: FlightRecord, ground: FlightRecord) -> tuple[int, float]:
    """Return session and clock offset (s) of the two sides of one flight; RecordError where they are none."""
    if vehicle.is_of_ground:
        raise RecordError(f"{vehicle.path}: is the record of a law on the ground: give that of the vehicle first")
    if vehicle.ground is not None:
        raise RecordError(f"{vehicle.path}: has been merged with the ground's record already")
    if not ground.is_of_ground:
        raise RecordError(f"{ground.path}: is no record of `companion law`: their names end with -ground-SESSION.mcap")
    if "link_session" not in vehicle.columns:
        raise RecordError(f"{vehicle.path}: its law ran on board: there is no ground's record to merge it with")
    known, other = _sessions(vehicle), _sessions(ground)
    if not known & other:
        names = [", ".join(map(str, sorted(one))) or "none" for one in (known, other)]
        raise RecordError(
            f"{ground.path}: is of another session: {names[1]}, and that of {vehicle.path.name} is {names[0]}"
        )
    session = min(known & other)
    offset_s = _offset_s(ground, session)
    apart_s = _apart_s(vehicle.columns["time_s"], ground.columns["time_s"] + offset_s)
    if apart_s > _APART_S:
        raise RecordError(
            f"{ground.path}: is of another flight of the same session: {apart_s:.0f} s lie between it and "
            f"{vehicle.path.name}"
        )
    return session, offset_s


def _sessions(record: FlightRecord) -> set[int]:
    return {int(one) for one in np.unique(record.columns.get("link_session", np.zeros(0))) if one > 0.0}


def _offset_s(ground: FlightRecord, session: int) -> float:
    """Return the median of the offsets that the ground measured in a session."""
    offsets = ground.columns["link_clock_offset_s"][ground.columns["link_session"] == session]
    known = offsets[np.isfinite(offsets)]
    if not known.size:
        raise RecordError(f"{ground.path}: never heard the vehicle's clock: it cannot be merged")
    return float(np.median(known))


def _apart_s(one_s: np.ndarray, other_s: np.ndarray) -> float:
    return float(max(one_s[0] - other_s[-1], other_s[0] - one_s[-1], 0.0))


_Timed = tuple[int, int, "_Copied"]
"""Log time (ns), side, and the message."""


@dataclass(frozen=True)
class _Copied:
    """Message to be written."""

    source: "_Source"
    channel: Channel
    schema: Schema | None
    time_ns: int
    data: bytes


@dataclass(frozen=True)
class _Shift:
    """Conversion of the ground's times."""

    offset_s: float
    """Vehicle's monotonic clock less the ground's."""
    log_ns: int
    """The same of the Unix times of the messages."""


@dataclass
class _Source:
    """Messages and metadata of one file; those of a ground are shifted."""

    path: Path
    shift: _Shift | None = None
    metadata: list[dict[str, str]] = field(default_factory=list)

    def messages(self, side: int) -> Iterator[_Timed]:
        """Yield the messages in their order; the metadata is complete after the last one."""
        channels: dict[int, Channel] = {}
        schemas: dict[int, Schema] = {}
        with self.path.open("rb") as file:
            for record in McapFile(file):
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Metadata) and record.name == META:
                    self.metadata.append(record.metadata)
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    if self.shift is None or channel.topic not in _LEFT_OUT:
                        time_ns, data = self._converted(record)
                        yield time_ns, side, _Copied(self, channel, schemas.get(channel.schema_id), time_ns, data)

    def _converted(self, message: Message) -> tuple[int, bytes]:
        shift = self.shift
        if shift is None:
            return message.log_time, message.data

        def later(found: re.Match[bytes]) -> bytes:
            return b'"%s":%s' % (found[1], repr(float(found[2]) + shift.offset_s).encode())

        return message.log_time + shift.log_ns, _TIMES.sub(later, message.data)


class _Copy:
    """Writer of messages that come from several files."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._channels: dict[tuple[Path, int], int] = {}
        self._sequence = 0

    def message(self, copied: _Copied) -> None:
        """Write one message, and its channel before the first one."""
        key = copied.source.path, copied.channel.id
        if key not in self._channels:
            self._channels[key] = self._channel(copied)
        self._sequence += 1
        self._writer.add_message(
            channel_id=self._channels[key],
            log_time=copied.time_ns,
            data=copied.data,
            publish_time=copied.time_ns,
            sequence=self._sequence,
        )

    def _channel(self, copied: _Copied) -> int:
        channel, schema, schema_id = copied.channel, copied.schema, 0
        if schema is not None:
            schema_id = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        topic = channel.topic if copied.source.shift is None else GROUND_TOPICS + channel.topic.removeprefix("/")
        return self._writer.register_channel(topic, channel.message_encoding, schema_id, channel.metadata)
