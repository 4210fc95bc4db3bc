"""PX4's failsafe state machine: what each loss leads to, what falls back, what a pilot may end."""

from dataclasses import replace

import pytest

from mock_autopilot.px4.failsafe import CRITICAL, EMERGENCY, LOW, Action, Failsafe, FailsafeFlags
from mock_autopilot.px4.params import ParamTable
from mock_autopilot.px4.sticks import Sticks
from mock_autopilot.px4.vocabulary import Mode

WELL = FailsafeFlags(
    now_s=10.0, landed=False, local_ok=True, global_ok=False, offboard_ok=True, offboard_attitude=True, remote=True
)


def _armed(**params: float) -> Failsafe:
    failsafe = Failsafe(ParamTable(params))
    failsafe.arm(WELL)
    assert failsafe.select(Mode.OFFBOARD, False, WELL) is Action.NONE
    return failsafe


@pytest.mark.parametrize(
    ("obl", "remote", "local_ok", "action"),
    [
        (0, True, True, Action.POSITION),
        (0, False, True, Action.LAND),  # Return, which needs a place on earth
        (0, False, False, Action.ALTITUDE),
        (1, True, True, Action.ALTITUDE),
        (3, True, True, Action.LAND),
        (4, True, True, Action.LAND),
        (4, True, False, Action.DESCEND),
        (5, True, True, Action.LAND),
        (7, True, True, Action.DISARM),
    ],
)
def test_setpoints_lost(obl: int, remote: bool, local_ok: bool, action: Action) -> None:
    failsafe = Failsafe(ParamTable({"COM_OBL_RC_ACT": obl}))
    before = replace(WELL, remote=remote)
    failsafe.arm(before)
    assert failsafe.select(Mode.OFFBOARD, False, replace(before, offboard_ok=False, local_ok=local_ok)) is action
    if action is not Action.DISARM:
        assert failsafe.select(Mode.OFFBOARD, False, before) is Action.NONE, "with the setpoints it ends by itself"


@pytest.mark.parametrize(("reaction", "action"), [(0, Action.NONE), (2, Action.LAND), (3, Action.LAND)])
def test_sticks_lost(reaction: int, action: Action) -> None:
    failsafe = _armed(NAV_RCL_ACT=reaction)
    gone = replace(WELL, remote=False)
    assert failsafe.select(Mode.OFFBOARD, False, gone) is action
    assert failsafe.select(Mode.OFFBOARD, False, WELL) is action, "it stays until a mode is chosen"
    assert failsafe.select(Mode.OFFBOARD, True, WELL) is Action.NONE


def test_sticks_that_were_not_there_at_arming_are_optional_until_they_come() -> None:
    failsafe = Failsafe(ParamTable({"NAV_RCL_ACT": 3}))
    without = replace(WELL, remote=False)
    failsafe.arm(without)
    assert failsafe.select(Mode.OFFBOARD, False, without) is Action.NONE
    assert failsafe.select(Mode.OFFBOARD, False, WELL) is Action.NONE
    assert failsafe.select(Mode.OFFBOARD, False, without) is Action.LAND


def test_sticks_may_be_excepted_in_offboard() -> None:
    assert _armed(NAV_RCL_ACT=3, COM_RCL_EXCEPT=4).select(Mode.OFFBOARD, False, replace(WELL, remote=False)) == 0


@pytest.mark.parametrize(
    ("setting", "warning", "action"),
    [
        (0, EMERGENCY, Action.WARN),
        (2, LOW, Action.WARN),
        (2, CRITICAL, Action.LAND),
        (3, CRITICAL, Action.LAND),  # Return, which needs a place on earth
        (3, EMERGENCY, Action.LAND),
    ],
)
def test_battery(setting: int, warning: int, action: Action) -> None:
    failsafe = _armed(COM_LOW_BAT_ACT=setting)
    assert failsafe.select(Mode.OFFBOARD, False, replace(WELL, battery_warning=warning)) is action


def test_a_battery_that_was_as_low_when_armed_only_warns() -> None:
    failsafe = Failsafe(ParamTable({"COM_LOW_BAT_ACT": 2}))
    low = replace(WELL, battery_warning=CRITICAL)
    failsafe.arm(low)
    assert failsafe.select(Mode.OFFBOARD, False, low) is Action.WARN


def test_where_hold_can_be_flown_it_holds_first() -> None:
    failsafe = _armed(NAV_RCL_ACT=3, COM_FAIL_ACT_T=5.0)
    gone = replace(WELL, remote=False, global_ok=True)
    assert failsafe.select(Mode.OFFBOARD, False, gone) is Action.HOLD
    assert failsafe.delays
    assert failsafe.select(Mode.OFFBOARD, False, replace(gone, now_s=14.9)) is Action.HOLD
    assert failsafe.select(Mode.OFFBOARD, False, replace(gone, now_s=15.1)) is Action.LAND


def test_a_pilot_ends_a_failsafe_by_a_mode_and_a_new_cause_begins_another() -> None:
    failsafe = _armed(NAV_RCL_ACT=3, COM_LOW_BAT_ACT=2)
    gone = replace(WELL, remote=False)
    assert failsafe.select(Mode.OFFBOARD, False, gone) is Action.LAND
    assert failsafe.select(Mode.OFFBOARD, True, gone) is Action.WARN, "the user's mode is flown, the loss is known"
    assert failsafe.select(Mode.OFFBOARD, False, gone) is Action.WARN
    assert failsafe.select(Mode.OFFBOARD, False, replace(gone, battery_warning=CRITICAL)) is Action.LAND


def test_landing_it_stays_with_the_landing() -> None:
    failsafe = _armed()
    assert failsafe.select(Mode.LAND, True, replace(WELL, offboard_ok=False)) is Action.NONE
    assert failsafe.select(Mode.LAND, False, replace(WELL, local_ok=False)) is Action.DESCEND


@pytest.mark.parametrize(("way", "speed", "moved"), [(0.5, 1.0, True), (0.5, 0.2, False), (0.02, 1.0, False)])
def test_sticks_take_over_when_they_move_fast(way: float, speed: float, moved: bool) -> None:
    """COM_RC_STICK_OV 30: faster than 0.3 of the full deflection a second, filtered with 0.1 s."""
    sticks = Sticks(ParamTable({"COM_RC_IN_MODE": 2}))
    now_s, place = 1.0, 0.0
    for _ in range(80):
        now_s, place = now_s + 0.02, min(place + speed * 0.02, way)
        assert sticks.update((place, 0.0, 0.0, 0.0), now_s)
    assert sticks.moved is moved


def test_sticks_are_lost_with_the_next_look() -> None:
    sticks = Sticks(ParamTable({"COM_RC_IN_MODE": 2}))
    assert not sticks.there(0.0)
    sticks.update((0.0, 0.0, 0.0, 0.0), 2.0)
    assert sticks.there(2.59)
    assert not sticks.there(2.61)
    assert not Sticks(ParamTable({"COM_RC_IN_MODE": 4})).update((0.0, 0.0, 0.0, 0.0), 1.0)
