"""Calls of the autopilot that the flight loop does not wait for."""

import asyncio
from typing import Any

from companion.flight.autopilot_calls import AutopilotCalls
from companion.supervisor.flight_state import Action


class Slow:
    """An autopilot that answers late, or not before the link is back."""

    def __init__(self, answers: bool = True) -> None:
        self.link = asyncio.Event()
        if answers:
            self.link.set()
        self.asked: list[str] = []
        self.waiting = 0
        self.done: list[str] = []

    def __getattr__(self, name: str) -> Any:
        async def answer() -> None:
            self.asked.append(name)
            self.waiting += 1
            try:
                await self.link.wait()
                await asyncio.sleep(0.01)
            finally:
                self.waiting -= 1
            self.done.append(name)

        return answer


async def test_whoever_waits_for_nothing_more_still_waits_for_motors_to_stop() -> None:
    autopilot: Any = Slow()
    calls = AutopilotCalls(autopilot)
    calls.begin(Action.AUTOPILOT_LAND)
    calls.begin(Action.KILL)
    await asyncio.sleep(0)
    await calls.cancel()
    assert autopilot.done == ["kill"]
    assert not calls.pending


async def test_a_kill_goes_on_when_even_the_waiting_is_cancelled() -> None:
    autopilot: Any = Slow()
    calls = AutopilotCalls(autopilot)
    calls.begin(Action.KILL)
    waiting = asyncio.create_task(calls.cancel())
    await asyncio.sleep(0)
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)
    assert calls.pending
    await asyncio.sleep(0.05)
    assert autopilot.done == ["kill"]


async def turns() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


async def test_on_a_dead_link_one_call_of_each_kind_waits_and_the_operator_reads_why() -> None:
    dead: Any = Slow(answers=False)
    calls = AutopilotCalls(dead)
    for asked in range(1, 11):
        calls.begin(Action.AUTOPILOT_LAND)
        calls.begin(Action.DISARM)
        await turns()
        assert dead.asked.count("land") == asked, "asked again, not only waited for"
        assert dead.waiting == 2
    assert calls.failure == "the autopilot has not done it yet and is asked once more: disarm"
    await calls.cancel()
    assert (dead.waiting, calls.pending) == (0, False)
    calls.forget()
    assert calls.failure == "", "it is no reason of the next flight"


async def test_a_kill_goes_first_and_nothing_beside_it() -> None:
    dead: Any = Slow(answers=False)
    calls = AutopilotCalls(dead)
    calls.begin(Action.DISARM)
    await turns()
    calls.begin(Action.OFFBOARD)
    calls.begin(Action.KILL)
    await turns()
    assert dead.asked == ["disarm", "kill"], "what had not begun yet does not begin any more"
    for action in (Action.KILL, Action.AUTOPILOT_LAND):
        calls.begin(action)
        await turns()
    assert (dead.asked, dead.waiting) == (["disarm", "kill"], 1)
    dead.link.set()
    await calls.cancel()
    assert dead.done == ["kill"]
