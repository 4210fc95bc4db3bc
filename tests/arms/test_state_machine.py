"""The arms' state machine: every phase against every phase of the flight, faults, and coming to rest."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from companion.arms.state_machine import (
    MAY_MOVE,
    MUST_STOW,
    ArmAction,
    ArmFacts,
    ArmPhase,
    ArmRules,
    ArmState,
    Braked,
    advance,
    goal_at,
    play,
    refusal,
    stop,
)
from companion.arms.trajectory import JointTrajectory, Sinusoid, minimum_jerk
from companion.core.interfaces import ArmError
from companion.core.types import Array
from companion.supervisor.flight_state import Phase

HOME, FOLDED = np.full(8, 0.4), np.full(8, -0.5)
SWING = Sinusoid(HOME, np.full(8, 0.4), np.full(8, 4.0), np.zeros(8), 20.0)
DT_S = 0.01


def fold(held_rad: Array) -> JointTrajectory | None:
    return None if np.allclose(held_rad, FOLDED) else minimum_jerk(held_rad, FOLDED, 2.0)


def no_way(held_rad: Array) -> JointTrajectory:
    raise ArmError("the left forearm would meet the body")


RULES = ArmRules(stow_from=fold)


def facts(time_s: float, flight: Phase = Phase.HOLD, **changes: object) -> ArmFacts:
    seen = ArmFacts(time_s=time_s, held_rad=HOME, obey=True, fault="", stowed=False, flight=flight, touched_down=False)
    return replace(seen, **changes)  # type: ignore[arg-type]


def holding() -> ArmState:
    return advance(ArmState(), facts(0.0, Phase.STANDBY), RULES)


def moving() -> ArmState:
    return play(holding(), SWING, facts(0.0))


def stowing() -> ArmState:
    return advance(holding(), facts(8.0, Phase.STOW), RULES)


def failed() -> ArmState:
    return advance(moving(), facts(8.0, fault="left.claw (servo 8): overload"), RULES)


STATES = {"off": ArmState(), "holding": holding(), "moving": moving(), "stowing": stowing(), "failed": failed()}


def speed(arms: ArmState, time_s: float) -> float:
    goal = goal_at(arms, time_s)
    return 0.0 if goal is None else float(np.abs(goal.velocity_radps).max())


def test_the_states_tried_are_every_phase() -> None:
    assert {arms.phase for arms in STATES.values()} == set(ArmPhase)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("flight", Phase)
def test_no_combination_of_facts_raises_or_makes_a_goal_jump(state: str, flight: Phase) -> None:
    arms = STATES[state]
    for torque, fault, stowed, down in itertools.product((True, False), ("", "broken"), (True, False), (True, False)):
        seen = facts(8.0, flight, obey=torque, fault=fault, stowed=stowed, touched_down=down)
        before, after = goal_at(arms, 8.0), goal_at(advance(arms, seen, RULES), 8.0)
        if before is not None and after is not None:
            assert after.position_rad == pytest.approx(before.position_rad)
            assert after.velocity_radps == pytest.approx(before.velocity_radps)


def test_with_torque_they_hold_where_they_are() -> None:
    goal = goal_at(holding(), 5.0)
    assert goal is not None
    assert goal.position_rad == pytest.approx(HOME)
    assert not goal.velocity_radps.any()
    assert goal_at(ArmState(), 5.0) is None, "limp arms are asked for nothing"


@pytest.mark.parametrize("flight", Phase)
def test_a_motion_begins_only_where_the_flight_allows_it(flight: Phase) -> None:
    assert (refusal(holding(), SWING, flight) == "") == (flight in MAY_MOVE)
    after = play(holding(), SWING, facts(1.0, flight))
    assert (after.phase is ArmPhase.MOVING) == (flight in {Phase.STANDBY, Phase.HOLD, Phase.TRACK, Phase.DISARMED})


@pytest.mark.parametrize("state", ["off", "moving", "stowing", "failed"])
def test_a_motion_begins_only_from_rest_with_torque_and_without_fault(state: str) -> None:
    assert play(STATES[state], SWING, facts(8.0)) is STATES[state]
    assert refusal(STATES[state], SWING, Phase.HOLD).startswith("the arms must hold still first, they are")


def test_a_motion_that_begins_elsewhere_is_refused_by_name() -> None:
    off = HOME.copy()
    off[5] += 0.09
    elsewhere = minimum_jerk(off, FOLDED, 2.0)
    before = holding()  # the very same: arrays inside make two of them neither equal nor unequal
    assert play(before, elsewhere, facts(1.0)) is before
    assert (
        refusal(holding(), elsewhere, Phase.HOLD) == "the motion begins 5 degrees from where left.elbow_pitch is held"
    )


@pytest.mark.parametrize("flight", [phase for phase in Phase if phase not in MAY_MOVE | MUST_STOW])
def test_where_the_flight_allows_no_motion_they_come_to_rest_on_their_way(flight: Phase) -> None:
    assert speed(moving(), 8.0) > 0.5
    braking = advance(moving(), facts(8.0, flight), RULES)
    assert braking.phase is ArmPhase.HOLDING
    assert isinstance(braking.motion, Braked)
    assert braking.reason == f"arms may not move in flight phase {flight}"
    assert refusal(braking, SWING, Phase.HOLD), "not before they stand still"
    arms, time_s, last = replace(braking), 8.0, goal_at(braking, 8.0)
    while arms.motion is not None:
        time_s += DT_S
        arms = advance(arms, facts(time_s, flight), RULES)
        now = goal_at(arms, time_s)
        assert now is not None
        assert last is not None
        assert np.abs(now.position_rad - last.position_rad).max() < 0.012, "no step"
        last = now
    assert time_s == pytest.approx(8.5, abs=2 * DT_S)
    assert speed(arms, time_s) == 0.0


@pytest.mark.parametrize("flight", sorted(MUST_STOW))
def test_before_the_floor_they_come_to_rest_fold_and_then_hold(flight: Phase) -> None:
    arms, time_s = moving(), 8.0
    seen: list[ArmPhase] = []
    while time_s < 11.0:
        arms = advance(arms, facts(time_s, flight), RULES)
        seen += [] if seen and seen[-1] is arms.phase else [arms.phase]
        time_s += DT_S
    assert seen == [ArmPhase.HOLDING, ArmPhase.STOWING, ArmPhase.HOLDING], "brake, fold once, hold"
    goal = goal_at(arms, time_s)
    assert goal is not None
    assert goal.position_rad == pytest.approx(FOLDED)


@pytest.mark.parametrize("flight", sorted(MUST_STOW))
def test_a_motion_that_happens_to_pass_the_stowed_pose_is_ended_all_the_same(flight: Phase) -> None:
    braking = advance(moving(), facts(8.0, flight, stowed=False), RULES)
    assert isinstance(braking.motion, Braked)


def test_folded_arms_need_not_fold() -> None:
    assert advance(holding(), facts(2.0, Phase.STOW, stowed=True), RULES).phase is ArmPhase.HOLDING


def test_arms_that_find_no_way_to_fold_come_to_rest_and_say_why_once() -> None:
    asked: list[Array] = []

    def refuse(held_rad: Array) -> JointTrajectory:
        asked.append(held_rad)
        return no_way(held_rad)

    arms, rules = moving(), ArmRules(stow_from=refuse)
    for n in range(200):
        arms = advance(arms, facts(8.0 + n * DT_S, Phase.STOW), rules)
    assert (arms.phase, arms.motion) == (ArmPhase.HOLDING, None)
    assert arms.no_way == "the arms cannot be stowed: the left forearm would meet the body"
    assert len(asked) == 1
    assert play(arms, minimum_jerk(asked[0], HOME, 1.0), facts(11.0)).no_way == "", "elsewhere there may be one"


@pytest.mark.parametrize("state", ["off", "holding", "moving", "stowing"])
def test_a_fault_holds_everything_once_and_stays(state: str) -> None:
    arms = advance(STATES[state], facts(8.0, fault="right.elbow_pitch (servo 2): silent"), RULES)
    assert (arms.phase, arms.action) == (ArmPhase.FAULT, ArmAction.HOLD)
    assert arms.reason == "right.elbow_pitch (servo 2): silent"
    assert goal_at(arms, 8.0) is None, "no goal is sent that could move a joint"
    again = advance(arms, facts(8.01, fault="right.elbow_pitch (servo 2): silent"), RULES)
    assert (again.phase, again.action) == (ArmPhase.FAULT, None)
    for flight in MUST_STOW:
        assert advance(again, facts(9.0, flight, fault="still"), RULES).phase is ArmPhase.FAULT, "never a sudden move"


def test_only_clearing_leaves_a_fault() -> None:
    there = np.full(8, 0.7)
    arms = advance(failed(), facts(20.0, held_rad=there), RULES)
    goal = goal_at(arms, 20.0)
    assert arms.phase is ArmPhase.HOLDING
    assert goal is not None
    assert goal.position_rad == pytest.approx(there), "they hold where they are now, not where they were going"
    assert advance(failed(), facts(20.0, obey=False), RULES).phase is ArmPhase.OFF


def test_limp_arms_are_off_whatever_they_did() -> None:
    for state in ("holding", "moving", "stowing"):
        arms = advance(STATES[state], facts(8.0, obey=False), RULES)
        assert (arms.phase, goal_at(arms, 8.0)) == (ArmPhase.OFF, None)


@pytest.mark.parametrize("wanted", [True, False])
def test_after_a_landing_the_torque_goes_only_if_so_configured(wanted: bool) -> None:
    rules = replace(RULES, torque_off_after_landing=wanted)
    landed = facts(30.0, Phase.DISARMED, touched_down=True, stowed=True)
    assert (advance(holding(), landed, rules).action is ArmAction.TORQUE_OFF) == wanted
    if wanted:
        gone = advance(holding(), landed, rules)
        assert advance(gone, landed, rules).action is None, "once a landing"
        again = advance(advance(gone, facts(40.0, Phase.PREFLIGHT, stowed=True), rules), landed, rules)
        assert again.action is ArmAction.TORQUE_OFF, "and after the next one, too"
    in_the_air = replace(landed, touched_down=False)
    assert advance(holding(), in_the_air, rules).action is None, "disarmed in the air is no landing"


def test_a_stop_asked_for_twice_is_one_stop() -> None:
    once = stop(moving(), facts(8.0), "asked")
    assert stop(once, facts(8.1), "asked again") is once
    still = holding()
    assert stop(still, facts(8.0), "nothing moves") is still


def greatest(trajectory: JointTrajectory, name: str) -> float:
    times = np.linspace(0.0, trajectory.duration_s, 500)
    values: Array = getattr(trajectory.at(times), name)
    return float(np.abs(values).max())


@pytest.mark.parametrize("begun_s", [2.5, 5.0, 7.7, 19.9])
def test_braking_stays_on_the_planned_path_and_is_smooth(begun_s: float) -> None:
    braked = Braked(SWING, begun_s, 0.5)
    step_s = 1e-5
    times = np.linspace(step_s, 0.5 - step_s, 200)
    before, now, after = (braked.at(times + by) for by in (-step_s, 0.0, step_s))
    slope = (after.position_rad - before.position_rad) / (2 * step_s)
    bend = (after.velocity_radps - before.velocity_radps) / (2 * step_s)
    assert now.velocity_radps == pytest.approx(slope, abs=1e-6)
    assert now.acceleration_radps2 == pytest.approx(bend, abs=1e-3)
    assert not braked.at(0.5).velocity_radps.any()
    path = SWING.at(np.linspace(begun_s, begun_s + 0.25, 2000)).position_rad[:, 0]
    off = np.abs(braked.at(times).position_rad[:, :1] - path[None, :]).min(axis=1)
    assert off.max() < 1e-3, "nowhere but where the motion would have gone"
    assert greatest(braked, "velocity_radps") <= greatest(SWING, "velocity_radps")
