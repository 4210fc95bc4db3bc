"""Messages of a record to columns, one row a tick, and to events."""

import math
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from mcap.records import Message
from pydantic_core import from_json

EVENTS = "/event"
GROUND = "ground"
"""Side of the link that has written a record, in its metadata; and that part of a merged file."""
GROUND_TOPICS = f"/{GROUND}/"
"""Begin of the ground's topics in a merged file."""
_FLAGS = (
    "airborne", "touched_down", "armed", "event", "begun", "connected", "in_air", "theirs", "failsafe",
    "link_connected", "link_blind", "link_failed", "link_flying",
)  # fmt: skip


@dataclass(frozen=True)
class RecordedEvent:
    """Event of a flight: a command, a reply, the begin or end of a fault."""

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
    """Message of the fault when it began."""
    reaction: str
    """Reaction that the table gives for that stage."""
    end_s: float = math.inf
    """Infinite: still there at the record's end."""


class Table:
    """Table of rows, built from a file's messages."""

    def __init__(self) -> None:
        self.topics: dict[int, str] = {}
        self.ticks: list[int] = []
        self.events: list[RecordedEvent] = []
        self.health: list[HealthEvent] = []
        self._present: dict[str, int] = {}
        self._messages = 0
        self._found: dict[tuple[str, ...], list[tuple[Any, ...]]] = {}
        """Messages with the same names: number of the message, row, values in the names' order."""

    def take(self, message: Message) -> None:
        """Add the next message, in the order in which they were written."""
        topic = self.topics[message.channel_id]
        if topic == EVENTS:
            said = from_json(message.data)
            self.events.append(RecordedEvent(said["time_s"], said["kind"], said["text"]))
            return
        if not message.data.startswith(b'{"tick":'):
            return
        values = from_json(message.data)
        if "events" in values:
            values |= self._health(values["time_s"], values.pop("events"), values.pop("arm_faults"))
        number = values.pop("tick")
        if not self.ticks or number != self.ticks[-1]:
            self.ticks.append(number)
        if topic != "/flight":
            values.pop("time_s", None)
        self._messages += 1
        self._found.setdefault((*values,), []).append((self._messages, len(self.ticks) - 1, *values.values()))

    def _health(self, time_s: float, events: list[dict[str, str]], arm_faults: list[dict[str, str]]) -> dict[str, str]:
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
        """Return the columns: numbers as float64, words as str, flags as bool."""
        columns: dict[str, np.ndarray] = {}
        for name, (rows, values) in self._by_name().items():
            try:
                columns[name] = self._column(rows, values)
            except ValueError:  # it had not the same shape everywhere: another law's signal of the same name
                columns |= self._by_shape(name, rows, values)
        columns["tick"] = np.array(self.ticks, np.float64)
        for name in _FLAGS:
            if name in columns:
                columns[name] = np.nan_to_num(columns[name]) > 0.0
        return columns | _derived(columns)

    def _by_name(self) -> dict[str, tuple[list[int], list[Any]]]:
        """Return the rows and values of each name, in the order of their messages."""
        found: dict[str, list[Any]] = {}
        for names, messages in self._found.items():
            numbers, rows, *columns = zip(*messages, strict=True)
            for name, values in zip(names, columns, strict=True):
                found.setdefault(name, []).append((numbers, rows, values))
        return {name: _merged(parts) for name, parts in found.items()}

    def _by_shape(self, name: str, rows: list[int], values: list[Any]) -> dict[str, np.ndarray]:
        """Name columns by shape: the first shape keeps the name, others get it with their shape."""
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


def _merged(parts: list[Any]) -> tuple[list[int], list[Any]]:
    """Return the rows and values of parts with numbers of messages, in the order of the numbers."""
    if len(parts) == 1:
        return list(parts[0][1]), list(parts[0][2])
    numbers, rows, values = ([*chain.from_iterable(column)] for column in zip(*parts, strict=True))
    order = sorted(range(len(numbers)), key=numbers.__getitem__)
    return [rows[index] for index in order], [values[index] for index in order]


def _derived(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    nothing = np.zeros(len(columns["time_s"]))

    def cut(*names: str) -> np.ndarray:
        return np.asarray(sum(np.nan_to_num(columns.get(f"cut_{name}", nothing)) for name in names) > 0.0)

    return {"limits_cut": cut("not_finite", "tilt", "thrust", "slew"), "guard_cut": cut("age", "fence")}
