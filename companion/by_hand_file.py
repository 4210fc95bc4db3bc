"""When the vehicle was last carried by hand, in a small JSON file."""

import json
from datetime import datetime
from pathlib import Path

from companion.config_preflight import PreflightConfig
from companion.preflight.by_hand import Kept

_NAME = "by_hand.json"


def read_kept(wanted: PreflightConfig) -> Kept | None:
    """What the file says; None when there is none, or nothing that can be read."""
    try:
        data = json.loads(_file(wanted).read_text(encoding="utf-8-sig"))
        kept = Kept(str(data["body"]), datetime.fromisoformat(data["when"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return kept if kept.when.tzinfo is not None else None


def write_kept(wanted: PreflightConfig, kept: Kept) -> Path:
    """Write it anew; returns where. OSError naming the file when it cannot be written."""
    path = _file(wanted)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"body": kept.body, "when": kept.when.isoformat()}) + "\n", encoding="utf-8")
    return path


def _file(wanted: PreflightConfig) -> Path:
    return Path(wanted.state_folder).expanduser() / _NAME
