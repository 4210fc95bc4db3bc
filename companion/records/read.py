"""A flight's record back into columns, events and what a replay needs."""

import json
import math
import struct
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from companion.control.controller import ControlInput
from companion.estimation.state import EstimatorState
from companion.ports import CompanionError
from companion.records.exact import of_json
from companion.types import Array, AttitudeThrust, MocapFrame, Reference

MAGIC = b"\x89MCAP0\r\n"
META = "companion"
"""Name of the metadata record: `begin` and `start`, both JSON."""
EVENTS = "/event"
_FLAGS = ("airborne", "touched_down", "armed", "event", "begun", "connected", "in_air", "theirs")
_BROKEN = (McapError, EOFError, struct.error, ZstdError, ValueError, KeyError, IndexError, TypeError, RuntimeError)
"""What reading a file that was cut off, or is none, may raise."""


class RecordError(CompanionError):
    """A file is no record, or has not what is asked of it."""


@dataclass(frozen=True)
class RecordedEvent:
    """Something that was told: a command, a reply, a fault's begin or end."""

    time_s: float
    """By the service's monotonic clock, as all columns."""
    kind: str
    text: str


@dataclass(frozen=True)
class HealthEvent:
    """A fault, from when it was seen first until it was not any more."""

    time_s: float
    fault: str
    text: str
    """What was wrong, as it began."""
    reaction: str
    """What the table says to it at that stage."""
    end_s: float = math.inf
    """Infinite: still there at the record's end."""


@dataclass(frozen=True)
class RecordedTick:
    """What one cycle was given and made of it, exactly; arrays as the law had them."""

    number: int
    """Counted by the service: one is missing where rows were dropped."""
    time_s: float
    phase: str
    law: str
    frame: MocapFrame | None
    """The motion-capture frame that this cycle was the first to use."""
    given: ControlInput | None
    """All that the law saw; None while it sleeps."""
    begun: bool
    """The law began anew from this input."""
    accel_w_mps2: Array | None
    """What the law wanted."""
    event: bool
    signals: dict[str, Array]
    """The law's inner values, early and late ones."""
    setpoint: AttitudeThrust | None
    """After the gate."""
    sent_s: float


@dataclass(frozen=True)
class FlightRecord:
    """One flight."""

    path: Path
    columns: dict[str, np.ndarray]
    """One row a tick; NaN, "" or False where there was nothing. Recorder.arrays()' names and more: docs/records.md."""
    events: tuple[RecordedEvent, ...] = ()
    """What was told: commands, replies, and what else the service said."""
    health: tuple[HealthEvent, ...] = ()
    metadata: dict[str, Any] = field(default_factory=dict)
    """`config`, `controller`, `versions`, `seed` and whatever else the service told; empty in an old NPZ file."""
    start: dict[str, Any] = field(default_factory=dict)
    """`time_s`, `number` and `estimate` (JSON) of the first tick."""
    truncated: bool = False
    """The file ends in the middle: service and writer were killed."""

    @property
    def unix_offset_s(self) -> float:
        """Unix time less `time_s`; 0 where it was not recorded."""
        return float(self.metadata.get("unix_offset_s", 0.0))

    @property
    def dropped(self) -> int:
        """Ticks that the service had and the record has not."""
        numbers = self.columns.get("tick", np.zeros(0))
        return int(numbers[-1] - numbers[0]) + 1 - len(numbers) if len(numbers) else 0

    @cached_property
    def first_estimate(self) -> EstimatorState | None:
        """What the estimator knew after the first tick's frame; a replay begins with it."""
        known = self.start.get("estimate")
        return of_json(EstimatorState, json.dumps(known)) if known else None

    @property
    def signal_names(self) -> tuple[str, ...]:
        """The laws' inner values, without `law_`."""
        return tuple(
            name.removeprefix("law_") for name in self.columns if name.startswith("law_") and name not in _OURS
        )

    def ticks(self) -> Iterator[RecordedTick]:
        """Every recorded cycle; RecordError when the record is an old one, which has not all that is needed."""
        missing = [name for name in ("tick", "frame_number", "frame_rotation_w_b") if name not in self.columns]
        if missing:
            raise RecordError(f"{self.path}: no column {missing[0]}: too old or too short a record for a replay")
        names = self.signal_names
        for row in range(len(self.columns["time_s"])):
            yield self._tick(row, names)

    def _tick(self, row: int, names: tuple[str, ...]) -> RecordedTick:
        c = self.columns
        flown = "given_dt_s" in c and np.isfinite(c["given_dt_s"][row])
        sent = "setpoint_thrust" in c and np.isfinite(c["setpoint_thrust"][row])
        return RecordedTick(
            int(c["tick"][row]),
            float(c["time_s"][row]),
            str(c["phase"][row]),
            str(c["law_name"][row]),
            self._frame(row) if np.isfinite(c["frame_stamp_s"][row]) else None,
            self._given(row) if flown else None,
            bool(flown and c["begun"][row]),
            c["accel_w_mps2"][row] if flown else None,
            bool(c["event"][row]),
            {name: c[f"law_{name}"][row] for name in names if not np.isnan(c[f"law_{name}"][row]).all()},
            AttitudeThrust(c["setpoint_q_w_flu_wxyz"][row], np.asarray(c["setpoint_thrust"][row])) if sent else None,
            float(c["sent_s"][row]),
        )

    def _frame(self, row: int) -> MocapFrame:
        c = self.columns
        return MocapFrame(
            int(c["frame_number"][row]),
            float(c["frame_stamp_s"][row]),
            float(c["frame_received_s"][row]),
            c["frame_position_w_m"][row],
            c["frame_rotation_w_b"][row],
            float(c["frame_residual_m"][row]),
            int(c["frame_late"][row]),
        )

    def _given(self, row: int) -> ControlInput:
        c = {name.removeprefix("given_"): column for name, column in self.columns.items() if name.startswith("given_")}
        return ControlInput(
            c["position_w_m"][row],
            c["velocity_w_mps"][row],
            c["q_w_flu_wxyz"][row],
            c["rate_flu_radps"][row],
            float(c["age_s"][row]),
            Reference(
                c["reference_position_w_m"][row],
                c["reference_velocity_w_mps"][row],
                c["reference_acceleration_w_mps2"][row],
                float(c["reference_yaw_rad"][row]),
            ),
            c["sent_accel_w_mps2"][row],
            float(c["dt_s"][row]),
            c["known_accel_w_mps2"][row],
        )


_OURS = frozenset({"law_name"})


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
    table, metadata, truncated = _Table(), _Metadata(), False
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


class _Table:
    """Messages to rows."""

    def __init__(self) -> None:
        self.topics: dict[int, str] = {}
        self.ticks: list[int] = []
        self.events: list[RecordedEvent] = []
        self.health: list[HealthEvent] = []
        self._present: dict[str, int] = {}
        self._found: dict[str, tuple[list[int], list[Any]]] = {}
        """Rows and values, by column."""

    def take(self, message: Message) -> None:
        topic = self.topics[message.channel_id]
        if topic == EVENTS:
            said = json.loads(message.data)
            self.events.append(RecordedEvent(said["time_s"], said["kind"], said["text"]))
            return
        if not message.data.startswith(b'{"tick":'):
            return
        values = json.loads(message.data)
        if "events" in values:
            values |= self._health(values["time_s"], values.pop("events"), values.pop("arm_faults"))
        number = values.pop("tick")
        if not self.ticks or number != self.ticks[-1]:
            self.ticks.append(number)
        row = len(self.ticks) - 1
        for name, value in values.items():
            if name == "time_s" and topic != "/flight":
                continue
            rows, found = self._found.setdefault(name, ([], []))
            rows.append(row)
            found.append(value)

    def _health(self, time_s: float, events: list[dict[str, str]], arm_faults: list[dict[str, str]]) -> dict[str, str]:
        """The columns of faults; those that begin or end go into `health`."""
        now = {event["fault"]: event for event in events}
        for fault in [fault for fault in self._present if fault not in now]:
            begun = self._present.pop(fault)
            self.health[begun] = replace(self.health[begun], end_s=time_s)
        for fault, event in now.items():
            if fault not in self._present:
                self._present[fault] = len(self.health)
                self.health.append(HealthEvent(time_s, fault, event["text"], event["reaction"]))
        return {"faults": ", ".join(now), "arm_faults": "; ".join(fault["text"] for fault in arm_faults)}

    def columns(self) -> dict[str, np.ndarray]:
        """Numbers as float64, words as str, flags as bool."""
        columns: dict[str, np.ndarray] = {}
        for name, (rows, values) in self._found.items():
            try:
                columns[name] = self._column(rows, values)
            except ValueError:  # it had not the same shape everywhere: another law's signal of the same name
                columns |= self._by_shape(name, rows, values)
        columns["tick"] = np.array(self.ticks, np.float64)
        for name in _FLAGS:
            if name in columns:
                columns[name] = np.nan_to_num(columns[name]) > 0.0
        return columns | _derived(columns)

    def _by_shape(self, name: str, rows: list[int], values: list[Any]) -> dict[str, np.ndarray]:
        """The first shape keeps the name, others are named after theirs."""
        shapes: dict[tuple[int, ...], tuple[list[int], list[Any]]] = {}
        for row, value in zip(rows, values, strict=True):
            of_shape = shapes.setdefault(np.shape(value), ([], []))
            of_shape[0].append(row)
            of_shape[1].append(value)
        names = [name, *("_".join([name, *map(str, shape)]) for shape in [*shapes][1:])]
        return {named: self._column(*found) for named, found in zip(names, shapes.values(), strict=True)}

    def _column(self, rows: list[int], values: list[Any]) -> np.ndarray:
        if isinstance(values[0], str):
            words = np.full(len(self.ticks), "", object)
            words[rows] = values
            return words.astype(str)
        numbers = np.array(values, np.float64)
        column = np.full((len(self.ticks), *numbers.shape[1:]), np.nan)
        column[rows] = numbers
        return column


def _derived(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What Recorder.arrays() has under other names."""
    nothing = np.zeros(len(columns["time_s"]))

    def cut(*names: str) -> np.ndarray:
        return np.asarray(sum(np.nan_to_num(columns.get(f"cut_{name}", nothing)) for name in names) > 0.0)

    return {"gate_cut": cut("not_finite", "tilt", "thrust", "slew"), "guard_cut": cut("age", "fence")}
