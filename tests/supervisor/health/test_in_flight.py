"""Law, loop, thrust, arms, times, broker and disk: at their limits."""

import math
from dataclasses import replace
from typing import Any

import pytest

from companion.supervisor.faults import Event, Fault
from companion.supervisor.health_inputs import HealthInputs
from tests.supervisor.observing import START_S, faults, healthy, on_ground, watched


def saturated(cycle: int) -> HealthInputs:
    return replace(healthy(cycle), at_max_thrust=True)


def test_thrust_may_be_at_its_limit_for_a_while() -> None:
    events = watched([saturated(k) for k in range(100)])
    assert [bool(found) for found in events] == [k >= 96 for k in range(100)]
    assert events[96] == (Event(Fault.THRUST_SATURATED, "thrust at its upper limit for 0.8 s"),)
    assert not any(watched([healthy(k) if k == 50 else saturated(k) for k in range(146)]))
    assert not any(watched([replace(saturated(k), airborne=False) for k in range(200)]))


def test_a_law_that_failed_and_arms_with_a_fault_say_why() -> None:
    assert watched([replace(healthy(0), law_fault="the law raised: no")]) == [
        (Event(Fault.LAW_FAILED, "the law raised: no"),)
    ]
    assert watched([on_ground(replace(healthy(0), arm_fault="the left elbow is hot"))]) == [
        (Event(Fault.ARMS, "the left elbow is hot"),)
    ]


def test_horizons_further_apart_than_corrected_say_so() -> None:
    assert watched([replace(healthy(0), horizon_fault="6 degrees off")]) == [
        (Event(Fault.HORIZON_CAPPED, "6 degrees off"),)
    ]


def late(cycle: int, late_s: float) -> HealthInputs:
    return replace(healthy(cycle), late_s=late_s)


def test_cycles_may_be_late_on_average() -> None:
    assert not any(watched([late(k, 1.0 / 32.0 if k % 2 else 0.0) for k in range(300)]))
    events = watched([late(k, 1.0 / 32.0 if k % 2 else 1.0 / 1024.0) for k in range(300)])
    assert [bool(found) for found in events] == [k >= 128 for k in range(300)]
    assert events[128] == (Event(Fault.LOOP_LATE, "control cycles begin 0.016 s late on average"),)


def test_a_stop_counts_for_a_second() -> None:
    events = watched([late(k, 2.015625 if k == 200 else 0.0) for k in range(400)])
    assert [k for k, found in enumerate(events) if found] == list(range(200, 328))
    assert not any(watched([late(k, 2.0 if k == 200 else 0.0) for k in range(400)]))


@pytest.mark.parametrize("late_s", [math.nan, math.inf, -math.inf])
def test_a_lateness_that_is_no_number_does_not_count(late_s: float) -> None:
    assert not any(watched([late(k, late_s) for k in range(300)]))
    events = watched([late(k, late_s if k % 2 else 1.0 / 32.0) for k in range(300)])
    assert faults(events[-1]) == [Fault.LOOP_LATE]
    assert events[-1][0].text == "control cycles begin 0.031 s late on average"


@pytest.mark.parametrize(
    ("allowed", "beyond", "fault", "text"),
    [
        (
            {"landing_due_s": START_S - 15.0},
            {"landing_due_s": START_S - 15.25},
            *(Fault.LANDING_TOO_LONG, "the landing is 15 s overdue"),
        ),
        (
            {"held_by_fault_since_s": START_S - 30.0},
            {"held_by_fault_since_s": START_S - 30.25},
            *(Fault.HOLD_TOO_LONG, "held by a fault for 30 s"),
        ),
        ({"operator_age_s": 2.0}, {"operator_age_s": 2.1}, Fault.OPERATOR_GONE, "no broker for 2.1 s"),
        (
            {"disk_free_mb": 200.0},
            {"disk_free_mb": 199.0},
            *(Fault.DISK_FULL, "199 MB free for records, less than 200 MB"),
        ),
    ],
)
def test_limits_of_time_broker_and_disk(
    allowed: dict[str, Any], beyond: dict[str, Any], fault: Fault, text: str
) -> None:
    assert watched([replace(healthy(0), **allowed)]) == [()]
    assert watched([replace(healthy(0), **beyond)]) == [(Event(fault, text),)]
