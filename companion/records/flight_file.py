"""Split of ticks into files: one per flight, from leaving standby until some seconds after its end."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from foxglove import Context

from companion.config.arms_config import ArmsConfig
from companion.records.channels import Channels, Mcap
from companion.records.retention import Retention, Unbreakable
from companion.records.row_codec import TIME, RecordRow, RowDecoder
from companion.records.scene import Scene

AFTER_S = 3.0
"""Recorded after the flight's end: what the arms and the autopilot do then."""
_FLUSH_S = 0.5
"""Time that is lost at most when the writer is killed."""
_LOOK_S = 1.0
"""Period of the checks of free disk space."""
_OVER = frozenset({"standby", "disarmed", "terminated"})
_NEW_FLIGHT = "preflight"


class FlightFiles:
    """Receiver of RowEncoder's messages, in order; disk errors are reported and never end a flight."""

    def __init__(self, retention: Retention, context: Context, report: Callable[[dict[str, Any]], None]) -> None:
        self._retention, self._context, self._report = retention, context, report
        self._channels, self._scene, self._decoder = Channels(context), Scene(context), RowDecoder()
        self._file: Mcap | None = None
        self._begin: dict[str, Any] = {}
        self._offset_s = 0.0
        self._laws: dict[str, None] = {}
        self._over_s: float | None = None
        self._flushed_s = self._looked_s = 0.0
        self._said = ("", "")

    def begin(self, message: bytes) -> None:
        """Store the metadata of the next flights from a BEGIN message."""
        self._begin |= json.loads(message[1:])
        self._offset_s = float(self._begin.get("unix_offset_s", self._offset_s))
        arms = (self._begin.get("config") or {}).get("arms")
        self._scene.arms = ArmsConfig.model_validate_json(json.dumps(arms)).model() if arms else None
        if self._file is not None:
            self._file.metadata("begin", json.dumps(self._begin))

    def learn(self, message: bytes) -> None:
        """Store the column layout of a LAYOUT message."""
        self._decoder.learn(message)

    def start(self, message: bytes) -> None:
        """Open a file for the flight that begins with the next row, on a START message."""
        text = message[1:].decode()
        said = json.loads(text)
        if self._file is not None and said["phase"] != _NEW_FLIGHT:
            return
        self.close()
        self._over_s, self._laws = None, {}
        if not self._retention.has_room():
            self._warn(
                f"less than {self._retention.config.min_free_mb:g} MB free for records: this flight is not recorded"
            )
            return
        try:
            part = str(self._begin.get("part", ""))
            self._open(self._retention.new_path(said["time_s"] + self._offset_s, part), text)
        except OSError as error:
            self._warn(f"this flight is not recorded: {error.filename or self._retention.folder}: {error.strerror}")

    def _open(self, path: Path, start: str) -> None:
        file = Unbreakable(path, lambda why: self._warn(f"{why}: the rest of this flight is not recorded"))
        self._file = Mcap(path, file, self._context)
        self._file.metadata("begin", json.dumps(self._begin))
        self._file.metadata("start", start)
        self._retention.rotate(path)
        self._report({"file": str(path)})

    def row(self, message: bytes) -> None:
        """Decode a ROW message, publish it, and record it during a flight."""
        row = self._decoder.row(message)
        time_s = float(row.block[TIME])
        time_ns = round(1e9 * (time_s + self._offset_s))
        recorded = self._file is not None
        self._channels.row(row, time_ns, recorded)
        self._scene.draw(row, time_ns, recorded)
        self._announce(row, time_ns)
        if self._file is not None:
            self._keep(self._file, row, time_s)

    def event(self, message: bytes) -> None:
        """Publish the event of an EVENT message: `time_s`, `kind`, `text`."""
        said = json.loads(message[1:])
        self._channels.event(said, round(1e9 * (said["time_s"] + self._offset_s)))

    def close(self) -> None:
        """Write the end metadata and close the flight's file."""
        file, self._file = self._file, None
        if file is None:
            return
        file.metadata("end", json.dumps({"laws": [*self._laws]}))
        file.close()
        if file.file.broken:
            return
        self._report({"closed": str(file.path)})

    def _keep(self, file: Mcap, row: RecordRow, time_s: float) -> None:
        """Flush, look for space, and close when the flight is over."""
        if row.cell("airborne") > 0.0:
            self._laws.setdefault(str(row.words["law_name"]))
        if not 0.0 <= time_s - self._flushed_s < _FLUSH_S:
            self._flushed_s = time_s
            file.flush()
        if file.file.broken:
            self.close()
        elif not 0.0 <= time_s - self._looked_s < _LOOK_S:
            self._looked_s = time_s
            if not self._retention.has_room():
                self._warn(
                    f"less than {self._retention.config.min_free_mb:g} MB free: the rest of this flight is not recorded"
                )
                self.close()
        phase = row.words["phase"]
        over = phase in _OVER or (phase == "handed over" and not row.cell("armed"))
        if not over:
            self._over_s = None
        elif self._over_s is None:
            self._over_s = time_s
        elif time_s - self._over_s > AFTER_S:
            self.close()

    def _announce(self, row: RecordRow, time_ns: int) -> None:
        said = (row.words["phase"], ", ".join(event["fault"] for event in row.words["events"]))
        if said == self._said:
            return
        if said[0] != self._said[0]:
            reason = row.words["reason"]
            self._channels.log("phase", f"{said[0]}: {reason}" if reason else said[0], time_ns)
        if said[1] != self._said[1]:
            texts = [f"{event['fault']}: {event['text']} ({event['reaction']})" for event in row.words["events"]]
            self._channels.log("faults", "; ".join(texts) or "none any more", time_ns, warning=bool(texts))
        self._said = said

    def _warn(self, text: str) -> None:
        self._report({"warning": text})
