"""Times at which faults are active: from lift-off, by phase, from now on."""

from typing import Any

import pytest

from mock_autopilot.faults.catalogue import Part
from mock_autopilot.faults.schedule import FaultSchedule, FaultTransition
from mock_autopilot.faults.sentences import parse
from tests.mock_autopilot.bench import NO_GPS, Bench

STEP_S = 0.01
ARMED_S, AIRBORNE_S, LANDING_S = 2.0, 3.0, 8.0


def _turns(*sentences: str, order_at_s: float = -1.0, order: str = "", to_s: float = 15.0) -> list[tuple[bool, Any]]:
    """Begins (True) and ends of a flight that is armed, in the air and landing at fixed times."""
    schedule = FaultSchedule([parse(sentence) for sentence in sentences])
    turns: list[FaultTransition] = []
    schedule.observers.append(turns.append)
    for count in range(round(to_s / STEP_S)):
        now_s = count * STEP_S
        if order and abs(now_s - order_at_s) < 0.5 * STEP_S:
            schedule.inject(parse(order), now_s)
        schedule.step(now_s, now_s >= ARMED_S, AIRBORNE_S <= now_s < 10.0, now_s >= LANDING_S)
        there = [turn.begins for turn in turns].count(True) - [turn.begins for turn in turns].count(False)
        lasting = [one for part in Part for one in schedule.active(part)]
        assert len(lasting) == there or any(not turn.fault.way.lasts for turn in turns)
    return [(turn.begins, pytest.approx(turn.time_s, abs=1e-6)) for turn in turns]


@pytest.mark.parametrize(
    ("sentence", "begin_s"),
    [
        ("mocap off", 0.0),
        ("mocap off on the ground after 1 s", 1.0),
        ("mocap off armed", ARMED_S),
        ("mocap off in the air after 2 s", AIRBORNE_S + 2.0),
        ("mocap off at 2 s", AIRBORNE_S + 2.0),
        ("mocap off landing", LANDING_S),
    ],
)
def test_it_begins_when_said_and_ends_when_said(sentence: str, begin_s: float) -> None:
    assert _turns(sentence) == [(True, begin_s)]
    assert _turns(f"{sentence} for 0.5 s") == [(True, begin_s), (False, begin_s + 0.5)]


def test_what_never_comes_does_not_begin() -> None:
    assert _turns("mocap off at 60 s") == []
    assert _turns("mocap off landing", to_s=LANDING_S - 1.0) == []


def test_an_order_is_from_now_on_or_waits_for_its_time_and_a_past_time_is_now() -> None:
    assert _turns(order="mocap off for 1 s", order_at_s=5.0) == [(True, 5.0), (False, 6.0)]
    assert _turns(order="mocap off at 4 s", order_at_s=5.0) == [(True, AIRBORNE_S + 4.0)]
    assert _turns(order="mocap off at 1 s", order_at_s=5.0) == [(True, 5.0)]
    assert _turns(order="mocap off armed", order_at_s=5.0) == [(True, 5.0)]


def test_what_happens_once_is_told_once_and_several_are_there_together() -> None:
    assert _turns("autopilot wrong (disarms) at 1 s") == [(True, AIRBORNE_S + 1.0)]
    both = _turns("mocap off armed for 4 s", "link off at 1 s for 1 s")
    assert both == [(True, ARMED_S), (True, 4.0), (False, 5.0), (False, 6.0)]


def test_the_phases_are_the_vehicles() -> None:
    """Lift-off by the truth, landing by PX4's own mode."""
    bench = Bench(NO_GPS, faults=["broker off armed", "broker stuck at 1 s", "broker delayed landing"])
    turns: list[FaultTransition] = []
    bench.world.faults.observers.append(turns.append)
    bench.vision = True
    bench.run(5.0)
    bench.fly_offboard(1.5)
    airborne_s, armed_s = turns[1].time_s - 1.0, turns[0].time_s
    assert armed_s < airborne_s, "armed before it lifted off"
    assert bench.world.vehicle.commander.armed_at_s == pytest.approx(armed_s, abs=0.003)
    bench.run(2.0)
    assert len(turns) == 2
    now_s = bench.now_s
    bench.command(21)
    assert turns[2].time_s == pytest.approx(now_s, abs=0.04), "with the commander's second pass"
