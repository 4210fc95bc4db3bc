"""The sizes of the messages, as docs/split.md has them, and the largest ones against a datagram."""

import re
from pathlib import Path

import numpy as np
import pytest

from companion.adapters.law_link.udp import introduction
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.core.types import JointMotion
from companion.law_link.codec import packed
from companion.law_link.messages import Clock, Command, Kind, Pose, Text, UpMessage
from companion.law_link.plan import plan_of
from companion.law_link.sealing import Seal
from companion.trajectories.reference import Hold
from tests.law_link.ends import HOVER, Joined, shown

PAGE = Path(__file__).resolve().parents[2] / "docs" / "split.md"
_LARGEST_BYTES = 1400
_BUDGET_BYTES_PER_S = 1000.0


def sealed_size(message: UpMessage | Text) -> int:
    return len(Seal(bytes(32)).sealed(packed(message)))


def up(kind: Kind, pose: Pose | None = None) -> int:
    """Return the bytes of a message up."""
    command = Command(accel_w_mps2=(0.0, 0.0, 0.0), yaw_rad=0.0, capture_ago=0) if kind is Kind.EVENT else None
    clock = Clock(offset=0, sent_bytes=0, again=0, round_trip=0) if kind is Kind.CLOCK else None
    return sealed_size(
        UpMessage(kind=kind, session=1, sequence=1, stamp=1, number=1, epoch=1, command=command, clock=clock, pose=pose)
    )


def down(joined: Joined) -> int:
    report = joined.vehicle.report(shown(0), joined.now_s)
    assert report is not None
    return len(report)


def planned(joined: Joined, with_arms: bool) -> int:
    zero = np.zeros(8)
    joints = (lambda _: JointMotion(zero, zero, zero)) if with_arms else None
    plan = joined.vehicle.plan(plan_of(0.0, Hold(np.zeros(3)).at, joints))
    assert plan is not None
    return len(plan)


@pytest.fixture(scope="module")
def rows() -> dict[str, str]:
    """Return the column of bytes by the message's name."""
    page = PAGE.read_text(encoding="utf-8")
    found = re.findall(r"(?m)^\| ([A-Z, ]+) \| [\w, ]+ \| ([^|]+) \|", page)
    return dict(found)


def test_the_page_has_the_sizes_of_the_code(rows: dict[str, str]) -> None:
    joined = Joined()
    assert rows["BEAT"] == f"{up(Kind.BEAT)}"
    assert rows["EVENT"] == f"{up(Kind.EVENT)}"
    assert rows["CLOCK"] == f"{up(Kind.CLOCK)}"
    assert rows["REPORT"] == f"{down(joined)}"
    assert rows["PLAN"] == f"{planned(joined, False)}, with arms {planned(joined, True)}"


def test_the_pose_adds_8_bytes() -> None:
    pose = Pose(position_w_m=(0.0, 0.0, 1.0), yaw_rad=0.0)
    for kind in (Kind.BEAT, Kind.EVENT, Kind.CLOCK):
        assert up(kind, pose) - up(kind) == 8


def test_every_message_fits_into_one_datagram() -> None:
    config = CompanionConfig(arms=ArmsConfig())
    hello = Text(kind=Kind.HELLO, nonce=bytes(16), text=introduction(config, "a" * 64).text())
    assert sealed_size(hello) < _LARGEST_BYTES
    assert planned(Joined(), True) < _LARGEST_BYTES


def test_a_flight_with_five_events_a_second_keeps_the_budget_of_the_uplink() -> None:
    """Beats fill the gaps, so an event in place of a beat costs the difference alone."""
    joined = Joined()
    before = joined.ground.counts.bytes_up
    for cycle in range(1000):
        joined.ground.flags |= 1
        joined.cycle(HOVER if cycle % 20 == 0 else None)
        joined.report(shown(joined.ground.newest_number))
    per_second = (joined.ground.counts.bytes_up - before) / 10.0
    assert per_second < _BUDGET_BYTES_PER_S
