"""The recorded sessions re-enacted: the mock tells what PX4 told, channel by channel."""

import pytest

from tests.mock_autopilot.reenact.compare import table
from tests.mock_autopilot.reenact.known import CAPTURES, CHANNELS, SAVED, known, names, rows_of
from tests.mock_autopilot.reenact.session import load


def cases() -> list[object]:
    listed = known()
    xfail = pytest.mark.xfail(strict=True, reason="a known difference: python -m tests.mock_autopilot.reenact.known")
    return [
        pytest.param(name, channel, marks=[xfail] if channel in listed.get(name, []) else [])
        for name in names()
        for channel in CHANNELS
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "channel"), cases())
def test_the_mock_tells_what_px4_told(name: str, channel: str) -> None:
    different = [row for row in rows_of(name) if row.differs and row.channel == channel]
    assert not different, f"\n{table(different)}"


def test_every_channel_is_compared() -> None:
    recorded = {event.channel for name in names() for event in load(CAPTURES / f"{name}{SAVED}").events}
    assert recorded == set(CHANNELS)
