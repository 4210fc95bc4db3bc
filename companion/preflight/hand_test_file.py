"""Time of the last hand test, in a small JSON file of the vehicle's state folder."""

import json
import os
import shlex
import sys
from datetime import datetime
from pathlib import Path

from companion.config.preflight_config import PreflightConfig
from companion.core.errors import ConfigError
from companion.preflight.checks.hand_test import HandTest

_NAME = "by_hand.json"


def hand_test_path(wanted: PreflightConfig) -> Path:
    """Return where it is kept; with `~` that is another place for each user."""
    return Path(wanted.state_folder).expanduser() / _NAME


def read_hand_test(wanted: PreflightConfig) -> HandTest | str:
    """Return what the file says, or the reason why it says nothing, which names it."""
    path = hand_test_path(wanted)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        when = datetime.fromisoformat(data["when"])
        kept = HandTest(str(data["body"]), when, str(path))
    except FileNotFoundError:
        return f"never: there is no {path}"
    except OSError as error:
        return f"{path} cannot be read ({error.strerror})"
    except (ValueError, KeyError, TypeError):
        return f"{path} is damaged"
    return kept if when.tzinfo is not None else f"{path} is damaged"


def write_hand_test(wanted: PreflightConfig, kept: HandTest) -> Path:
    """Replace the file and return its path. OSError naming the file when it cannot be written."""
    path = hand_test_path(wanted)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"body": kept.body, "when": kept.when.isoformat()}) + "\n", encoding="utf-8")
    return path


def require_writable(wanted: PreflightConfig) -> None:
    """Raise ConfigError, with the command that can, when this user cannot write there; for before the carrying."""
    path = hand_test_path(wanted)
    folder = next(one for one in path.parents if os.path.lexists(one))
    may_enter = os.access(folder, os.X_OK)  # one that it may not: what is in there cannot be seen either
    if may_enter and os.access(path if os.path.lexists(path) else folder, os.W_OK):
        return
    if may_enter and folder != path.parent:
        raise ConfigError(
            f"cannot keep that the vehicle was carried in {path} (preflight.state_folder): {path.parent} is not there "
            f"and cannot be made by this user; run this on the vehicle, or give another folder"
        )
    command = shlex.join(["sudo", "-u", _owner(folder), "-H", *sys.argv])
    raise ConfigError(
        f"cannot keep that the vehicle was carried in {path} (preflight.state_folder): it belongs to the vehicle's "
        f"service; carry it as that user: `{command}`"
    )


def _owner(path: Path) -> str:
    try:
        return path.owner()
    except KeyError:
        return f"#{path.stat().st_uid}"  # one without a name, as sudo takes it
