"""Foxglove channels for rows and events: the same for a file and for live viewers."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import foxglove
from foxglove import Channel, Context, Schema
from foxglove.channels import LogChannel
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import Log, LogLevel, Timestamp

from companion.records.json_rows import JsonRows, Shapes, schema_of
from companion.records.row_codec import Layout, RecordRow

EVENT = "/event"
META = "companion"
_EVENT_SCHEMA = {
    "type": "object",
    "properties": {"time_s": {"type": "number"}, "kind": {"type": "string"}, "text": {"type": "string"}},
}
_WHOLE_CHUNKS = MCAPWriteOptions(chunk_size=None, disable_seeking=True, compression_threads=0)
"""A chunk goes to the file at once, when it is flushed: what is killed leaves no half one in the middle."""


class Channels:
    """Foxglove channels of all topics, opened as rows and events need them."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._json: dict[str, Channel] = {}
        self._shapes: dict[str, Shapes] = {}
        self._rows = JsonRows()
        self._seen: set[Layout] = set()
        """Their topics are there to be watched."""
        self._event = Channel(EVENT, schema=_EVENT_SCHEMA, context=context)
        self._log = LogChannel("/log", context=context)

    def row(self, row: RecordRow, time_ns: int, recorded: bool) -> None:
        """Log all topics of a row; does nothing while it is neither recorded nor watched."""
        if not recorded and row.layout in self._seen and not any(one.has_sinks() for one in self._json.values()):
            return
        self._seen.add(row.layout)
        for message in self._rows.messages(row):
            shapes = self._shapes.get(message.topic)
            if shapes is not message.shapes and (shapes is None or not message.shapes.items() <= shapes.items()):
                self._widen(message.topic, message.shapes)
            self._json[message.topic].log(message.data.encode(), log_time=time_ns)

    def _widen(self, topic: str, shapes: Shapes) -> None:
        if topic in self._json:
            self._json[topic].close()
        known = self._shapes[topic] = self._shapes.get(topic, {}) | shapes
        schema = Schema(name=topic.strip("/"), encoding="jsonschema", data=schema_of(topic, known))
        self._json[topic] = Channel(topic, schema=schema, message_encoding="json", context=self._context)

    def event(self, said: dict[str, Any], time_ns: int) -> None:
        """Log an event with `time_s`, `kind` and `text`."""
        self._event.log(json.dumps(said).encode(), log_time=time_ns)
        self.log(said["kind"], said["text"], time_ns)

    def log(self, name: str, text: str, time_ns: int, warning: bool = False) -> None:
        """Log a line for Foxglove's log panel."""
        level = LogLevel.Warning if warning else LogLevel.Info
        self._log.log(Log(timestamp=stamp(time_ns), level=level, name=name, message=text), log_time=time_ns)


def stamp(time_ns: int) -> Timestamp:
    """Return a Foxglove timestamp, seconds and nanoseconds."""
    return Timestamp(sec=time_ns // 10**9, nsec=time_ns % 10**9)


class Mcap:
    """Open MCAP file that receives everything logged to the context's channels."""

    def __init__(self, path: Path, file: Any, context: Context) -> None:
        self.path, self.file = path, file
        self._writer: Any = foxglove.open_mcap(file, context=context, writer_options=_WHOLE_CHUNKS)
        self.flush: Callable[[], None] = self._writer.flush

    def metadata(self, name: str, text: str) -> None:
        """Write a JSON text as the metadata record `name`."""
        self._writer.write_metadata(META, {name: text})

    def close(self) -> None:
        """Write the summary section and close the file."""
        self._writer.close()
        self.file.close()
