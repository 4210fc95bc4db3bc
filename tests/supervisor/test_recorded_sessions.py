"""Conclusions of the supervisor from what a real PX4 v1.17 told it: who flies, why, and in which words."""

import pytest

from companion.core.types import FlightMode
from companion.supervisor.flight_state import Action, KillRequest, Phase, ResumeRequest
from tests.supervisor.recorded_sessions import Cycled, actions_of, first_s, phases_of, sentences_of, watched


def last(cycles: list[Cycled]) -> Cycled:
    return cycles[-1]


@pytest.mark.parametrize(("name", "told_to_land_s"), [("px4-mocap1", 25.842), ("px4-mocap_gone", 25.673)])
def test_px4_is_told_to_land_once_as_recorded_and_nobody_is_taken_for_a_pilot(
    name: str, told_to_land_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    cycles = watched(name, monkeypatch)
    assert phases_of(cycles) == [Phase.HOLD, Phase.HANDED_OVER, Phase.DISARMED]
    assert first_s(cycles, Phase.HANDED_OVER) == pytest.approx(told_to_land_s, abs=0.02)
    assert actions_of(cycles) == [Action.AUTOPILOT_LAND]
    assert last(cycles).flight.reason == "no usable pose for 0.25 s: no frames arrive"
    assert not any(cycle.flight.theirs or cycle.status.failsafe for cycle in cycles)


def test_a_short_gap_of_motion_capture_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = watched("px4-mocap02", monkeypatch, until_s=30.0)
    assert phases_of(cycles) == [Phase.HOLD]
    assert [text.split(" is ")[0] for text in sentences_of(cycles)] == ["the newest usable pose"] * 2


def test_px4s_own_landing_after_the_remote_control_was_lost_is_no_pilots(monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = watched("px4-rc_lost", monkeypatch)
    assert phases_of(cycles) == [Phase.HOLD, Phase.HANDED_OVER, Phase.DISARMED]
    assert first_s(cycles, Phase.HANDED_OVER) == pytest.approx(26.084, abs=0.02)
    assert actions_of(cycles) == [], "PX4 lands already"
    why = "the autopilot's own failsafe has chosen mode land, not offboard: Failsafe activated"
    assert last(cycles).flight.reason == why
    disarmed_s = next(cycle.time_s for cycle in cycles if cycle.status.last_text == "Disarmed by landing")
    assert not any(cycle.flight.theirs for cycle in cycles if cycle.time_s < disarmed_s)
    assert "Failsafe activated" in {cycle.status.last_text for cycle in cycles}


def test_the_pilots_position_mode_is_a_pilots_until_the_operator_takes_it_back(monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = watched("px4-pilot_position", monkeypatch, [(30.6, ResumeRequest())], until_s=33.0)
    assert phases_of(cycles) == [Phase.HOLD, Phase.HANDED_OVER, Phase.RESUME]
    assert last(cycles).flight.phase is Phase.HOLD
    assert first_s(cycles, Phase.HANDED_OVER) == pytest.approx(25.532, abs=0.02)
    taken = [cycle for cycle in cycles if cycle.flight.phase is Phase.HANDED_OVER]
    assert all(cycle.flight.theirs for cycle in taken[1:])
    assert taken[0].flight.reason == "the autopilot shows mode position, not offboard"
    assert actions_of(cycles) == [Action.OFFBOARD]


def test_a_refused_hold_leaves_the_flight_alone_and_px4s_words_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = watched("px4-pilot_hold", monkeypatch, until_s=33.0)
    assert phases_of(cycles) == [Phase.HOLD]
    assert sentences_of(cycles) == []
    assert last(cycles).status.last_text == "Switching to Hold is currently not available"


def test_the_battery_is_low_when_a_quarter_is_left_and_before_px4_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = watched("px4-battery", monkeypatch, until_s=66.5)
    assert phases_of(cycles) == [Phase.HOLD, Phase.LAND]
    px4_low_s = next(cycle.time_s for cycle in cycles if cycle.status.last_text == "Low battery")
    assert first_s(cycles, Phase.LAND) == pytest.approx(60.5, abs=0.1)
    assert px4_low_s == pytest.approx(64.81, abs=0.02)
    assert sentences_of(cycles)[0] == "23 % of the battery's charge left, below 25 %"


def test_a_killed_vehicle_is_terminated_and_shows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = watched("px4-killcmd", monkeypatch, [(26.445, KillRequest())])
    assert phases_of(cycles) == [Phase.HOLD, Phase.TERMINATED]
    assert (last(cycles).status.armed, last(cycles).status.mode) == (False, FlightMode.OFFBOARD)
    assert last(cycles).status.last_text == "Disarmed by external command"


def test_a_dead_px4_is_silent_and_then_rebooted_and_disarmed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorded simulator died with it: motion capture had no vehicle to see either."""
    cycles = watched("px4-px4_killed", monkeypatch, until_s=40.0)
    assert phases_of(cycles) == [Phase.HOLD, Phase.HANDED_OVER, Phase.DISARMED]
    assert last(cycles).flight.reason == (
        "no usable pose for 0.25 s: no frames arrive; then nothing heard from the autopilot for 0.51 s"
    )
    assert "the autopilot rebooted: its time since boot went from 25.3 s to 0.0 s" in sentences_of(cycles)
    assert first_s(cycles, Phase.DISARMED) == pytest.approx(31.39, abs=0.02), "its first HEARTBEAT"


@pytest.mark.parametrize("name", ["px4-kill9", "px4-sigstop"])
def test_px4s_landing_without_us_is_a_failsafe_until_it_disarms(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cycles = watched(name, monkeypatch)
    landing = [cycle.status for cycle in cycles if cycle.status.mode is FlightMode.LAND]
    assert landing
    assert all(status.failsafe and status.armed for status in landing)
    final = last(cycles).status
    assert (final.armed, final.failsafe, final.in_air, final.mode) == (False, False, False, FlightMode.OFFBOARD)
