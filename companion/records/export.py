"""A record as tables for other programs."""

import csv
import json
import math
from dataclasses import astuple, fields
from itertools import product
from pathlib import Path

import numpy as np

from companion.records.read import FlightRecord, HealthEvent, RecordedEvent


def export_csv(record: FlightRecord, folder: Path) -> list[Path]:
    """Export ticks.csv, events.csv, faults.csv and metadata.json; floats at full precision, empty where missing.

    A merged record has ground_ticks.csv, too, with the ground's cycles.
    """
    folder.mkdir(parents=True, exist_ok=True)
    sides = {"ticks.csv": record} | ({"ground_ticks.csv": record.ground} if record.ground is not None else {})
    tables = {name: _rows(side.columns) for name, side in sides.items()} | {
        "events.csv": ([field.name for field in fields(RecordedEvent)], [astuple(event) for event in record.events]),
        "faults.csv": ([field.name for field in fields(HealthEvent)], [astuple(event) for event in record.health]),
    }
    for name, (heads, rows) in tables.items():
        with (folder / name).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(heads)
            writer.writerows(rows)
    metadata = folder / "metadata.json"
    metadata.write_text(json.dumps(record.metadata | {"start": record.start}, indent=2) + "\n", encoding="utf-8")
    return [*(folder / name for name in tables), metadata]


def _rows(columns: dict[str, np.ndarray]) -> tuple[list[str], list[tuple[object, ...]]]:
    names, cells = _flat(columns)
    return names, list(zip(*cells, strict=True))


def _flat(columns: dict[str, np.ndarray]) -> tuple[list[str], list[list[object]]]:
    names: list[str] = []
    cells: list[list[object]] = []
    for name in sorted(columns, key=lambda name: (name != "time_s", name != "tick", name)):
        column = columns[name]
        components = column.reshape(len(column), -1)
        for number, index in enumerate(product(*map(range, column.shape[1:]))):
            names.append("_".join([name, *map(str, index)]))
            values = components[:, number].tolist()
            cells.append(["" if isinstance(value, float) and math.isnan(value) else value for value in values])
    return names, cells
