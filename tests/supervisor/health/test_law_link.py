"""Link to a law on the ground: silence, age, losses, strangers, at their limits."""

import math
from dataclasses import replace
from typing import Any

import pytest

from companion.law_link.link_status import NO_LINK
from companion.supervisor.faults import Event, Fault, Stage
from companion.supervisor.health.law_link import check_law_link
from companion.supervisor.health_inputs import HealthInputs
from companion.supervisor.safety_rules import SafetyRules
from tests.supervisor.observing import healthy, watched

RULES = SafetyRules()
GOOD = replace(
    NO_LINK, connected=True, law="etnn", host="a workstation", session=7, silence_s=0.02, age_s=0.003, received=33
)


def inputs(command_age_s: float = 0.02, **link: Any) -> HealthInputs:
    return replace(healthy(0), link=replace(GOOD, **link), command_age_s=command_age_s)


def events(command_age_s: float = 0.02, **link: Any) -> list[Event]:
    return check_law_link(inputs(command_age_s, **link), RULES)


def faults(command_age_s: float = 0.02, **link: Any) -> list[Fault]:
    return [event.fault for event in events(command_age_s, **link)]


def test_a_good_link_and_a_law_on_board_are_no_fault() -> None:
    assert events() == []
    assert check_law_link(healthy(0), RULES) == []
    assert watched([inputs()]) == [()]


@pytest.mark.parametrize(
    ("age_s", "expected"),
    [
        (RULES.command_late_s, []),
        (math.nextafter(RULES.command_late_s, 1.0), [Fault.COMMAND_LATE]),
        (RULES.command_silent_s, [Fault.COMMAND_LATE]),
        (math.nextafter(RULES.command_silent_s, 1.0), [Fault.GROUND_LAW_SILENT]),
        (math.inf, [Fault.GROUND_LAW_SILENT]),
        (math.nan, [Fault.GROUND_LAW_SILENT]),
    ],
)
def test_silence_is_late_and_then_a_reason_to_land(age_s: float, expected: list[Fault]) -> None:
    assert faults(age_s) == expected


def test_silence_is_among_the_faults_of_a_cycle() -> None:
    [found] = watched([inputs(0.125)])
    assert found == (Event(Fault.COMMAND_LATE, "the ground law was last heard 0.125 s ago"),)


@pytest.mark.parametrize(
    ("link", "text"),
    [
        ({}, "nothing from the ground law on a workstation for 0.30 s: look at the link, and at `companion law`"),
        (
            {"blind": True},
            "the ground law on a workstation has had no fresh pose, or no plan of this vehicle, for 0.30 s: "
            "look at its motion capture and at the link",
        ),
        ({"failed": True, "blind": True}, "the law on a workstation has failed: look at its log"),
        ({"connected": False}, "no ground law has this vehicle"),
        ({"connected": False, "refused": "g differs"}, "no ground law has this vehicle: refused, g differs"),
    ],
)
def test_silence_says_why(link: dict[str, Any], text: str) -> None:
    assert events(0.3, **link) == [Event(Fault.GROUND_LAW_SILENT, text)]


@pytest.mark.parametrize("age_s", [0.0, 0.02, RULES.command_late_s])
def test_a_law_that_has_failed_is_not_waited_for(age_s: float) -> None:
    assert events(age_s, failed=True) == [
        Event(Fault.GROUND_LAW_SILENT, "the law on a workstation has failed: look at its log")
    ]


def test_commands_may_be_delayed_up_to_a_limit() -> None:
    assert faults(age_s=RULES.command_delayed_s) == []
    assert faults(age_s=math.nan) == [], "not known yet; preflight waits for it"
    assert events(age_s=0.0625) == [
        Event(Fault.COMMAND_DELAYED, "commands arrive 0.062 s after they were sent, more than 0.06 s")
    ]


@pytest.mark.parametrize(
    ("received", "missing", "late", "expected"),
    [
        (40, 60, 0, []),
        (39, 61, 0, [Fault.COMMANDS_LOST]),
        (30, 60, 10, []),
        (29, 61, 10, [Fault.COMMANDS_LOST]),
        (60, 0, 40, []),
        (59, 0, 41, [Fault.COMMANDS_REORDERED]),
        (3, 7, 0, [Fault.COMMANDS_LOST]),
        (2, 7, 0, []),  # too few to judge
        (5, 0, 5, [Fault.COMMANDS_REORDERED]),
        (4, 0, 5, []),
        (0, 0, 0, []),
    ],
)
def test_shares_of_a_second_are_judged_when_there_are_enough(
    received: int, missing: int, late: int, expected: list[Fault]
) -> None:
    assert faults(received=received, missing=missing, late=late) == expected


def test_shares_are_told_in_numbers() -> None:
    assert events(received=10, missing=50) == [
        Event(Fault.COMMANDS_LOST, "50 of 60 messages of a second did not arrive")
    ]
    assert events(received=10, late=30) == [
        Event(Fault.COMMANDS_REORDERED, "30 of 40 messages of a second arrived after a newer one")
    ]


def test_strangers_are_told() -> None:
    assert events(foreign=3, foreign_from="10.0.0.9:4711") == [
        Event(
            Fault.COMMANDS_FOREIGN,
            "3 datagrams in a second, the last from 10.0.0.9:4711, have a wrong key or session, or were played again: "
            "dropped",
        )
    ]
    assert events(rival="a laptop") == [
        Event(Fault.GROUND_LAW_TWICE, "the ground law on a laptop asks for this vehicle: refused")
    ]


def test_the_link_is_watched_while_setpoints_are_sent_and_while_the_autopilot_lands() -> None:
    silent = inputs(1.0, foreign=1)
    standing = replace(silent, streaming=False, stage=Stage.GROUND)
    landing = replace(silent, streaming=False, stage=Stage.HANDED_OVER)
    assert check_law_link(standing, RULES) == []
    assert [event.fault for event in check_law_link(landing, RULES)] == [
        Fault.GROUND_LAW_SILENT,
        Fault.COMMANDS_FOREIGN,
    ]
