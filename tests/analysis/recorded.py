"""Virtual flights as the service records them: through the record's own encoder and writer, into a file."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from foxglove import Context

from companion.config.companion_config import CompanionConfig
from companion.config.records_config import RecordsConfig
from companion.flight.tick import Tick
from companion.records.flight_file import FlightFiles
from companion.records.retention import Retention
from companion.records.row_codec import LAYOUT, ROW, START, RowEncoder
from companion.records.tick_columns import frozen

UNIX_OFFSET_S = 1.75e9


def recorded(
    ticks: Iterable[Tick],
    folder: Path,
    config: CompanionConfig | None = None,
    told: Sequence[tuple[float, str, str]] = (),
    **metadata: Any,
) -> Path:
    """The file of the one flight in `ticks`; `told` are times, kinds and texts of events."""
    records = RecordsConfig(folder=str(folder), live_port=0, min_free_mb=0.0)
    files = FlightFiles(Retention(records, "vehicle"), Context(), lambda _: None)
    begin = {
        "unix_offset_s": UNIX_OFFSET_S,
        "vehicle": "vehicle",
        "config": (config or CompanionConfig()).model_dump(mode="json"),
        "versions": {"companion": "0.1.0"},
    }
    files.begin(b"B" + json.dumps(begin | metadata).encode())
    encoder, waiting = RowEncoder(), sorted(told)
    do = {LAYOUT: files.learn, START: files.start, ROW: files.row}
    for tick in ticks:
        while waiting and waiting[0][0] <= tick.time_s:
            time_s, kind, text = waiting.pop(0)
            files.event(b"T" + json.dumps({"time_s": time_s, "kind": kind, "text": text}).encode())
        for message in encoder.messages(tick, frozen(tick)):
            do[message[:1]](message)
    files.close()
    (path,) = folder.glob("*.mcap")
    return path
