"""The recorded sessions re-enacted: the mock tells what PX4 told, channel by channel."""

import pytest

from tests.mock_autopilot.conformance import DOCUMENT
from tests.mock_autopilot.reenact.compare import table
from tests.mock_autopilot.reenact.known import CAPTURES, CHANNELS, SAVED, compared, known, names, rows_of
from tests.mock_autopilot.reenact.page import TITLE, section
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


@pytest.mark.slow
def test_the_documented_section_is_the_compared_one() -> None:
    _, title, rest = DOCUMENT.read_text(encoding="utf-8").partition(TITLE)
    assert title + rest == section(compared()), "run: make conformance"


def test_every_channel_is_compared() -> None:
    recorded = {event.channel for name in names() for event in load(CAPTURES / f"{name}{SAVED}").events}
    assert recorded == set(CHANNELS)
