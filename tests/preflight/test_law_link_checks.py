"""Tests of the link's lines: a good link passes, and each fault of it fails its own line with a remedy."""

import math
from dataclasses import replace
from typing import Any

import pytest

from companion.config.companion_config import CompanionConfig
from companion.law_link.link_status import NO_LINK, LinkStatus
from companion.preflight.checks.all_checks import check_all
from companion.preflight.checks.check import Check
from companion.preflight.checks.law_link import LawLinkFacts, check_law_link
from companion.supervisor.safety_rules import SafetyRules
from tests.preflight.facts import RECOMMENDED, ready

GOOD = replace(
    NO_LINK,
    connected=True,
    law="etnn",
    host="workstation (process 41)",
    session=0x1F,
    silence_s=0.012,
    age_s=0.0021,
    round_trip_s=0.0036,
    received=33,
)
LINK = LawLinkFacts(status=GOOD, version="0.6.0", where="0.0.0.0, UDP port 14600", key_file="/k", key_mode=0o600)


def checks(link: LinkStatus = GOOD, **facts: Any) -> tuple[Check, ...]:
    return check_law_link(replace(LINK, status=link, **facts), SafetyRules())


def failed(link: LinkStatus = GOOD, **facts: Any) -> list[Check]:
    return [check for check in checks(link, **facts) if not check.passed]


def test_a_good_link_passes_and_says_who_is_there() -> None:
    assert failed() == []
    says = {check.name: check.says for check in checks()}
    assert says["ground law"] == "etnn on workstation (process 41), session 001f"
    assert says["commands' age"] == "2.1 ms, median; at most 60 wanted"
    assert says["link's round trip"] == "3.6 ms; offset of the clocks known to 1.8 ms"
    assert says["commands lost"] == "0 of 33 messages in a second lost, 0 late"


@pytest.mark.parametrize(
    ("change", "name", "refuses"),
    [
        ({"silence_s": 0.13}, "ground law heard", False),
        ({"silence_s": 0.26}, "ground law heard", True),
        ({"silence_s": math.inf}, "ground law heard", True),
        ({"blind": True}, "ground law sees the vehicle", True),
        ({"failed": True}, "ground law sees the vehicle", True),
        ({"age_s": 0.061}, "commands' age", True),
        ({"age_s": math.nan}, "commands' age", True),
        ({"round_trip_s": math.nan}, "link's round trip", True),
        ({"round_trip_s": 0.041}, "link's round trip", False),
        ({"received": 33, "missing": 4}, "commands lost", False),
        ({"received": 33, "late": 4}, "commands lost", False),
        ({"received": 12, "missing": 19}, "commands lost", True),
        ({"received": 9}, "commands lost", True),
        ({"rival": "laptop (process 7)"}, "one ground law", False),
        ({"foreign": 3, "foreign_from": "192.168.0.66:5"}, "foreign datagrams", False),
    ],
)
def test_a_fault_of_the_link_fails_its_line_with_a_remedy(change: dict[str, Any], name: str, refuses: bool) -> None:
    [check] = failed(replace(GOOD, **change))
    assert (check.name, check.refuses) == (name, refuses)
    assert check.says
    assert check.todo


@pytest.mark.parametrize("change", [{"silence_s": 0.119}, {"age_s": 0.06}, {"missing": 3}, {"round_trip_s": 0.04}])
def test_just_inside_a_limit_passes(change: dict[str, Any]) -> None:
    assert failed(replace(GOOD, **change)) == []


@pytest.mark.parametrize(
    ("link", "says", "todo"),
    [
        (NO_LINK, "none has asked for this vehicle on 0.0.0.0, UDP port 14600", "start `companion law` on the ground"),
        (replace(NO_LINK, foreign=2, foreign_from="10.0.0.2:7"), "with the right key", "give both the same key file"),
        (
            replace(NO_LINK, refused="vehicle.mass_kg is 4.85 on the vehicle and 4.9 on the ground"),
            "refused: vehicle.mass_kg is 4.85 on the vehicle and 4.9 on the ground",
            "start `companion law` anew",
        ),
    ],
)
def test_without_a_ground_law_one_line_says_why_and_the_lines_that_need_one_are_left_out(
    link: LinkStatus, says: str, todo: str
) -> None:
    found = {check.name: check for check in checks(link)}
    assert set(found) == {"ground law", "key file", "foreign datagrams"}
    assert found["ground law"].refuses
    assert says in found["ground law"].says
    assert todo in found["ground law"].todo


@pytest.mark.parametrize(("mode", "passes"), [(0o600, True), (0o640, True), (0o644, False), (0o602, False)])
def test_a_key_that_everybody_may_read_refuses_arming(mode: int, passes: bool) -> None:
    key = next(check for check in checks(key_mode=mode) if check.name == "key file")
    assert key.passed is passes
    assert key.says == f"/k, mode {mode:o}"


def test_a_key_that_is_gone_refuses_arming() -> None:
    [check] = failed(key_mode=None)
    assert check.refuses
    assert check.says == "/k is not there"


def test_the_lines_are_part_of_the_list_for_a_law_on_the_ground_only() -> None:
    config = CompanionConfig()
    alone = {check.name for check in check_all(ready(), config, config.preflight, RECOMMENDED)}
    split = {check.name for check in check_all(replace(ready(), law_link=LINK), config, config.preflight, RECOMMENDED)}
    assert split - alone == {check.name for check in checks()}
