"""JSON messages of a row, one per topic; floats are written exactly, as `repr` does."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from companion.records.row_codec import TIME, WORDS, Layout, RecordRow
from companion.records.tick_columns import Column, Shape

Shapes = dict[str, Shape]
WITH_WORDS = "/flight"
"""Topic that also carries the text columns."""
_NO_NUMBER = {"nan": "null", "inf": "1e999", "-inf": "-1e999"}
"""JSON knows none of them; what reads a number too large makes it infinite."""
_ERROR: Shapes = {"position_error_w_m": (3,), "velocity_error_w_mps": (3,), "distance_m": ()}
_ERROR_TEMPLATE = (
    '{"tick":%s,"time_s":%s,"position_error_w_m":[%s,%s,%s],"velocity_error_w_mps":[%s,%s,%s],"distance_m":%s}'
)
_TABLES = {"type": "array", "items": {"type": "object"}}


@dataclass(frozen=True)
class Message:
    """Message of one topic, made of a row."""

    topic: str
    shapes: Shapes
    """Shapes of its numbers; the same object for every row of a layout."""
    data: str


@dataclass(frozen=True)
class _Topic:
    name: str
    shapes: Shapes
    template: str
    pick: Callable[[list[str]], tuple[str, ...]]


class JsonRows:
    """Converter of rows to JSON messages; caches its work for each layout."""

    def __init__(self) -> None:
        self._layouts: dict[Layout, list[_Topic]] = {}
        self._words: dict[str, Any] = {}
        self._said = ""

    def messages(self, row: RecordRow) -> list[Message]:
        """Return the messages of all topics of the row."""
        if row.words is not self._words:
            self._words, self._said = row.words, "," + json.dumps(row.words)[1:]
        topics = self._layouts.get(row.layout)
        if topics is None:
            topics = self._layouts[row.layout] = _topics(row.layout.columns)
        said = list(map(repr, row.block.tolist()))
        for where in np.flatnonzero(~np.isfinite(row.block)):
            said[where] = _NO_NUMBER[said[where]]
        number, time = str(row.number), said[TIME]
        parts = [
            Message(
                topic.name, topic.shapes, topic.template % (number, time, *topic.pick(said)) + self._end(topic.name)
            )
            for topic in topics
        ]
        return [*parts, *self._error(row, number, time)]

    @staticmethod
    def _error(row: RecordRow, number: str, time: str) -> list[Message]:
        if "position_w_m" not in row or "reference_position_w_m" not in row:
            return []
        position = (row.cell("position_w_m") - row.cell("reference_position_w_m")).tolist()
        velocity = (row.cell("velocity_w_mps") - row.cell("reference_velocity_w_mps")).tolist()
        said = [repr(value) for value in (*position, *velocity, math.hypot(*position))]
        return [Message("/error", _ERROR, _ERROR_TEMPLATE % (number, time, *[_NO_NUMBER.get(s, s) for s in said]))]

    def _end(self, topic: str) -> str:
        return self._said if topic == WITH_WORDS else "}"


def _topics(columns: tuple[Column, ...]) -> list[_Topic]:
    found: dict[str, list[tuple[str, Shape, int]]] = {}
    at = 0
    for topic, name, shape in columns:
        if name != "time_s":  # which every topic has
            found.setdefault(topic, []).append((name, shape, at))
        at += math.prod(shape)
    return [_topic(topic, named) for topic, named in found.items()]


def _topic(topic: str, named: list[tuple[str, Shape, int]]) -> _Topic:
    parts = [f"{json.dumps(name)}:".replace("%", "%%") + _holes(shape) for name, shape, _ in named]
    cells = [cell for _, shape, at in named for cell in range(at, at + math.prod(shape))]
    template = '{"tick":%s,"time_s":%s,' + ",".join(parts)
    pick: Any = itemgetter(*cells) if len(cells) > 1 else lambda said: tuple(said[cell] for cell in cells)
    return _Topic(topic, {name: shape for name, shape, _ in named}, template, pick)


def _holes(shape: Shape) -> str:
    if not shape:
        return "%s"
    return "[" + ",".join([_holes(shape[1:])] * shape[0]) + "]"


def schema_of(topic: str, shapes: Shapes) -> bytes:
    """Return the JSON Schema of a topic's messages, from which Foxglove knows what can be plotted."""
    known: dict[str, Any] = {"tick": {"type": "integer"}, "time_s": {"type": "number"}}
    properties = known | {name: _kind(shape) for name, shape in shapes.items()}
    if topic == WITH_WORDS:
        properties |= {word: {"type": "string"} for word in WORDS}
        properties |= {"events": _TABLES, "arm_faults": _TABLES}
    return json.dumps({"type": "object", "title": topic.strip("/"), "properties": properties}).encode()


def _kind(shape: Shape) -> dict[str, Any]:
    if not shape:
        return {"type": "number"}
    return {"type": "array", "items": _kind(shape[1:])}
