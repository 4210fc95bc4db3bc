"""JSON Schemas of the messages on the broker, generated from the models by `python -m companion.protocol.schema`."""

import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from companion.protocol.about import About
from companion.protocol.commands import COMMAND
from companion.protocol.intent import Intent
from companion.protocol.mocap import BridgePresence, MocapPose
from companion.protocol.telemetry import Happened, Presence, Reply, State
from companion.protocol.topics import VERSION

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "bus"
_OF: dict[str, TypeAdapter[Any]] = {
    "command": COMMAND,
    "reply": TypeAdapter(Reply),
    "event": TypeAdapter(Happened),
    "state": TypeAdapter(State),
    "status": TypeAdapter(Presence),
    "about": TypeAdapter(About),
    "intent": TypeAdapter(Intent),
    "mocap": TypeAdapter(MocapPose),
    "mocap-bridge": TypeAdapter(BridgePresence),
}
"""Models by the topic after the vehicle's name, with - for /."""


def printed() -> dict[str, str]:
    """Return the text of every schema file by its name."""
    return {f"{topic}.schema.json": _text(topic, model) for topic, model in _OF.items()}


def _text(topic: str, model: TypeAdapter[Any]) -> str:
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"{VERSION}/{topic}.schema.json"}
    return json.dumps(head | model.json_schema(), indent=2, ensure_ascii=False) + "\n"


def main() -> None:
    """Write all schema files to docs/bus/."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in printed().items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
