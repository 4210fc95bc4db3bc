"""Preflight on a vehicle that frames do not reach: what is off is said aloud, what it has instead is checked."""

from dataclasses import replace
from typing import Any

import pytest

from companion.config.companion_config import CompanionConfig
from companion.config.preflight_config import PreflightConfig
from companion.core.interfaces import ConfigError
from companion.preflight.checks.agreement import Difference
from companion.preflight.checks.all_checks import Facts, check_all
from companion.preflight.checks.check import Check, refusal
from companion.preflight.checks.mocap import MocapFacts
from companion.preflight.checks.without_frames import OFF_HERE, GroundPoseFacts
from companion.preflight.live_observer import require_frames
from companion.supervisor.without_frames import OFF
from tests.flights.simulated_ground import ground_config
from tests.preflight.facts import NOW_S, RECOMMENDED, STATUS, ready

CONFIG = ground_config(CompanionConfig(), onboard_mocap=False)
NOTHING_SEEN = MocapFacts(
    body="dauam", frames=0, seconds_s=1.0, tracked=0, age_s=0.0, delay_s=float("nan"), residual_m=float("nan")
)


def frameless() -> Facts:
    """Return facts of a vehicle that is ready, and gets no frames."""
    status = replace(STATUS, attitude_s=NOW_S - 0.02, velocity_s=NOW_S - 0.03)
    return replace(ready(), mocap=NOTHING_SEEN, status=status, ground=GroundPoseFacts(33, 1.0))


def checks_of(facts: Facts) -> tuple[Check, ...]:
    return check_all(facts, CONFIG, PreflightConfig(), RECOMMENDED)


def test_it_may_arm_and_every_kind_of_check_that_is_off_is_a_warning_of_its_own() -> None:
    checks = checks_of(frameless())
    assert refusal(checks) == ""
    off = [check for check in checks if check.says.startswith("off: ")]
    assert [check.name for check in off] == [
        "motion capture", "attitude comparison", "fence and tracking", "guard and horizon", "preflight checks",
    ]  # fmt: skip
    for check in off:
        assert (check.passed, check.must) == (False, False)
        assert check.says.endswith(", because frames do not reach the vehicle")
        assert "onboard_mocap" in check.todo
    said = " ".join(check.says for check in off)
    assert all(fault in said for fault in OFF)


def test_the_checks_that_it_says_are_off_are_those_that_are_left_out() -> None:
    with_frames = {check.name for check in check_all(ready(), CompanionConfig(), PreflightConfig(), RECOMMENDED)}
    without = {check.name for check in checks_of(frameless())}
    assert with_frames - without == set(OFF_HERE)
    assert {"heading agrees", "vision fused", "vision delay", "fence around the vehicle"} <= without


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"ground": GroundPoseFacts(14, 1.0)}, "ground's poses"),
        ({"ground": GroundPoseFacts(0, 0.0)}, "ground's poses"),
        ({"status": replace(STATUS, attitude_s=NOW_S - 0.02)}, "autopilot's motion"),
        ({"status": replace(STATUS, attitude_s=NOW_S - 0.02, velocity_s=NOW_S - 0.2)}, "autopilot's motion"),
        ({"status": replace(STATUS, attitude_s=NOW_S - 0.2, velocity_s=NOW_S)}, "autopilot's motion"),
        ({"apart": Difference(0.0, 0.0, 0.5)}, "heading agrees"),
    ],
)
def test_what_it_needs_instead_refuses_arming(change: dict[str, Any], name: str) -> None:
    failed = [check for check in checks_of(replace(frameless(), **change)) if check.refuses]
    assert [check.name for check in failed] == [name]
    assert failed[0].todo


def test_what_is_done_with_frames_alone_is_refused_with_what_to_do() -> None:
    require_frames(CompanionConfig())
    with pytest.raises(ConfigError, match=r"law\.onboard_mocap = true, on a computer that the frames reach"):
        require_frames(CONFIG)
