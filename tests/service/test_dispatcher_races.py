"""Commands that meet: what was sent before an order to stop must not begin after it, wherever it was then."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from companion.arms.state_machine import ArmPhase
from companion.core.interfaces import ArmError
from companion.flight.arm_step import ArmStep
from companion.protocol.commands import Track, Waypoint
from companion.protocol.telemetry import Answer
from companion.service.daemon import lives
from companion.service.planning import planned_track
from companion.supervisor.flight_state import Phase
from tests.service.test_dispatcher import Operated, flying, operated

pytestmark = pytest.mark.slow

BADLY = {Answer.FAILED, Answer.REFUSED}
GOTO: dict[str, Any] = {"x_m": 0.4, "y_m": 0.0, "z_m": 0.8}
SWINGING: dict[str, Any] = {"curve": "ellipse", "laps": 1, "period_s": 5.0, "size": 0.5, "arms": "swing"}
TO_END = ["kill", "abort", "land", "disarm"]


def with_word(verb: str) -> dict[str, Any]:
    return {"confirm": "kill"} if verb == "kill" else {}


def arms_of(op: Operated) -> ArmStep:
    arms = op.one.service.loop.arms
    assert arms is not None
    return arms


async def turns(until: Callable[[], bool]) -> None:
    while not until():  # noqa: ASYNC110
        await asyncio.sleep(0)


async def unfolded(op: Operated) -> None:
    """Held in the middle of a motion."""
    assert (await op.do("arms", do="ready")).answer is Answer.DONE
    playing = op.say("arms", do="play", motion="swing")
    await turns(lambda: bool(arms_of(op).off_stow) or playing.ended.is_set())
    assert (await op.do("arms", do="hold")).answer is Answer.DONE
    await playing.end()


@pytest.mark.parametrize("verb", TO_END)
async def test_an_arming_of_the_same_turn_does_not_follow(verb: str) -> None:
    async with operated() as op:
        arming = op.say("arm")
        assert (await op.do(verb, **with_word(verb))).answer is Answer.DONE
        assert (await arming.end()).answer in BADLY
        assert op.one.phase() in {Phase.STANDBY, Phase.TERMINATED}
        assert op.one.autopilot.asked == 0


@pytest.mark.parametrize("verb", ["kill", "abort"])
async def test_an_arming_that_still_folds_the_arms_ends_and_they_come_to_rest(verb: str) -> None:
    async with operated(arms=True) as op:
        await unfolded(op)
        arming = op.say("arm")
        await turns(lambda: arms_of(op).state.phase is ArmPhase.MOVING or arming.ended.is_set())
        assert (await op.do(verb, **with_word(verb))).answer is Answer.DONE
        ended = await arming.end()
        assert ended.answer is Answer.FAILED
        assert verb in ended.text
        await turns(lambda: arms_of(op).held_rad is not None)
        assert arms_of(op).off_stow, "it stopped on the way"
        assert op.one.autopilot.asked == 0


@pytest.mark.parametrize(("verb", "arguments"), [("goto", GOTO), ("track", {"curve": "ellipse"})])
@pytest.mark.parametrize("later", [0, 1])
async def test_a_hold_ends_what_is_still_planned(verb: str, arguments: dict[str, Any], later: int) -> None:
    async with operated() as op:
        await flying(op)
        going = op.say(verb, **arguments)
        for _ in range(later):
            await asyncio.sleep(0)
        assert (await op.do("hold")).answer is Answer.DONE
        assert (await going.end()).answer in BADLY
        assert op.one.phase() is Phase.HOLD
        assert len(op.one.service.loop.flight.legs) == 1


async def test_a_takeoff_of_the_same_turn_does_not_follow_a_disarm() -> None:
    async with operated() as op:
        assert (await op.do("arm")).answer is Answer.DONE
        climbing = op.say("takeoff")
        assert (await op.do("disarm")).answer is Answer.DONE
        assert (await climbing.end()).answer in BADLY
        assert not op.one.service.status.armed


async def test_a_hold_after_which_something_else_is_flown_does_not_say_that_it_hovers() -> None:
    async with operated() as op:
        await flying(op)
        holding, going = op.say("hold"), op.say("goto", **GOTO)
        held = await holding.end()
        assert held.answer is Answer.FAILED
        assert "another command took over" in held.text
        assert (await going.end()).answer is Answer.DONE


async def test_arms_that_are_to_hold_do_not_begin_what_is_still_planned() -> None:
    async with operated(arms=True) as op:
        assert (await op.do("arms", do="ready")).answer is Answer.DONE
        playing = op.say("arms", do="play", motion="swing")
        await asyncio.sleep(0)
        assert (await op.do("arms", do="hold")).answer is Answer.DONE
        assert (await playing.end()).answer in BADLY
        assert arms_of(op).held_rad is not None


async def test_an_abort_on_the_ground_stops_the_arms() -> None:
    async with operated(arms=True) as op:
        assert (await op.do("arms", do="ready")).answer is Answer.DONE
        playing = op.say("arms", do="play", motion="swing")
        await turns(lambda: bool(playing.replies))
        assert (await op.do("abort")).answer is Answer.DONE
        ended = await playing.end()
        assert ended.answer is Answer.FAILED
        assert "abort" in ended.text


async def test_arms_that_swing_with_a_trajectory_rest_when_it_is_held() -> None:
    async with operated(arms=True) as op:
        await flying(op)
        tracking = op.say("track", **SWINGING)
        await turns(lambda: op.one.phase() is Phase.TRACK)
        assert arms_of(op).state.phase is ArmPhase.MOVING
        assert (await op.do("hold")).answer is Answer.DONE
        assert (await tracking.end()).answer is Answer.FAILED
        await turns(lambda: arms_of(op).held_rad is not None)


async def test_nobody_else_moves_the_arms_that_a_command_counts_on() -> None:
    async with operated(arms=True) as op:
        arming = op.say("arm")
        refused = await op.do("arms", do="limp")
        assert refused.answer is Answer.REFUSED
        assert "arm (" in refused.text
        assert (await arming.end()).answer is Answer.DONE
        assert (await op.do("takeoff", height_m=0.8)).answer is Answer.DONE
        tracking = op.say("track", **SWINGING)
        assert (await op.do("arms", do="play", motion="swing")).answer is Answer.REFUSED
        assert (await tracking.end()).answer is Answer.DONE


async def test_a_trajectory_whose_arms_cannot_begin_is_not_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ArmError("left elbow is overloaded")

    async with operated(arms=True) as op:
        await flying(op)
        monkeypatch.setattr(op.one.service.arms, "begin", broken)
        ended = await op.do("track", **SWINGING)
        assert ended.answer is Answer.FAILED
        assert "overloaded" in ended.text
        assert (await op.do("hold")).answer is Answer.DONE
        assert op.one.phase() is Phase.HOLD
        assert max(abs(op.one.room.truth_w_m[:2])) < 0.1


async def test_a_command_of_the_turn_in_which_the_dispatcher_closes_is_answered_and_leaves_nothing() -> None:
    async with operated() as op:
        await flying(op)
        going = op.say("goto", **GOTO)
        await op.serving.aclose()
        assert going.replies[-1].answer in BADLY
        async with op.dispatcher.serving(op.one.service):
            assert (await op.do("goto", **GOTO)).answer is Answer.DONE


@pytest.mark.parametrize("verb", ["abort", "land", "disarm"])
async def test_what_somebody_else_flies_is_not_said_to_stand(verb: str) -> None:
    async with operated() as op:
        await flying(op)
        there = op.one.service.status
        async with operated() as other:
            other.one.service._autopilot.status = lambda: there  # type: ignore[method-assign]
            refused = await other.do(verb)
            assert refused.answer is Answer.REFUSED
            assert "in the air" in refused.text


async def test_a_path_is_solved_before_the_control_loop_looks_at_it() -> None:
    async with operated() as op:
        rows = tuple(Waypoint(t_s=float(t), x_m=0.01 * t, y_m=0.0, z_m=1.0) for t in range(400))
        sent = Track(verb="track", id="t", session="0" * 16, sent_s=1.0, waypoints=rows)
        plan = planned_track(sent, op.one.service, None)
        assert "_coefficients" in vars(plan.trajectory)


async def test_systemd_lets_a_loop_that_failed_see_the_landing_through() -> None:
    async with operated() as op:
        await flying(op)
        assert op.dispatcher.ticking
        assert lives(10.0, op.dispatcher.ticking, 10.4)
        assert not lives(10.0, op.dispatcher.ticking, 10.6), "it hangs"
        op.one.service.loop.ticking = False  # it has failed, and gives up
        assert lives(10.0, op.dispatcher.ticking, 30.0)
