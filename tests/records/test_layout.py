"""Test that records have every field that Foxglove's layout plots."""

import json
import re
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from tests.flights.command import ROOT
from tests.records.linked import flight_with_link
from tests.records.test_round_trip import written

LAYOUT: dict[str, Any] = json.loads((ROOT / "config" / "foxglove" / "layout.json").read_text(encoding="utf-8"))


def leaves(tree: Any) -> list[str]:
    return [tree] if isinstance(tree, str) else [*leaves(tree["first"]), *leaves(tree["second"])]


def test_every_panel_has_its_place_and_its_settings() -> None:
    assert sorted(leaves(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def test_every_path_is_in_the_schemas_and_messages_of_a_record(tmp_path: Path) -> None:
    (path,) = written(tmp_path, flight_with_link())
    said: dict[str, dict[str, Any]] = {}
    schemas: dict[str, dict[str, Any]] = {}
    topics = set()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            topics.add(channel.topic)
            if schema is not None and schema.encoding == "jsonschema":
                schemas[channel.topic] = json.loads(schema.data)["properties"]
                said.setdefault(channel.topic, {}).update(json.loads(message.data))
    assert {"/scene", "/tf", "/log"} <= topics
    panels = LAYOUT["configById"].values()
    paths = [one["value"] for panel in panels for one in panel.get("paths", ())]
    assert len(paths) > 15
    for value in paths:
        topic, name, place = re.fullmatch(r"(/\w+)\.(\w+)(?:\[(\d)\](?:\.\w+)?)?", value).groups()  # type: ignore[union-attr]
        assert name in schemas[topic], value
        cell = said[topic][name]
        assert (place is not None) == isinstance(cell, list), value
        assert name == "events" or place is None or int(place) < len(cell), value
