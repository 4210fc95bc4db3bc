"""The channels in which the mock is known to differ: `python -m tests.mock_autopilot.reenact.known` writes the list.

The tests hold it strictly: a channel that differs no more must leave it, and none may join it unseen.
"""

import json
import sys
from functools import cache
from pathlib import Path

from tests.mock_autopilot.reenact.compare import Row, compare
from tests.mock_autopilot.reenact.player import play
from tests.mock_autopilot.reenact.session import load
from tests.mock_autopilot.reenact.shorten import FOR_A_TEST, shortened

CAPTURES = Path(__file__).parents[2] / "data" / "reenact"
LIST = CAPTURES / "known_differences.json"
SAVED = ".json.gz"
CHANNELS = (
    "COMMAND_ACK", "STATUSTEXT", "HEARTBEAT", "CURRENT_MODE", "EXTENDED_SYS_STATE", "SYS_STATUS", "battery",
    "BATTERY_STATUS", "ESTIMATOR_STATUS", "COMMAND_LONG", "PARAM_VALUE", "reply",
)  # fmt: skip


def names() -> list[str]:
    """Return the sessions that are kept as captures."""
    return sorted(path.name.removesuffix(SAVED) for path in CAPTURES.glob(f"*{SAVED}"))


@cache
def rows_of(name: str) -> list[Row]:
    """Return the comparison of one of them, without its uneventful stretches."""
    session = shortened(load(CAPTURES / f"{name}{SAVED}"), FOR_A_TEST)
    return compare(session.events, play(session))


def compared() -> dict[str, list[Row]]:
    """Return the comparisons of all of them."""
    return {name: rows_of(name) for name in names()}


def known() -> dict[str, list[str]]:
    """Return the list as it stands."""
    return dict(json.loads(LIST.read_text(encoding="utf-8")))


def main() -> int:
    """Write the list as it is now."""
    different = {name: {row.channel for row in rows if row.differs} for name, rows in compared().items()}
    listed = {name: [one for one in CHANNELS if one in channels] for name, channels in different.items() if channels}
    LIST.write_text(json.dumps(listed, indent=2) + "\n", encoding="utf-8")
    print(LIST.read_text(encoding="utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
