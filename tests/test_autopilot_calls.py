"""Calls of the autopilot that the flight loop does not wait for."""

import asyncio
from typing import Any

from companion.autopilot_calls import AutopilotCalls
from companion.supervisor.flight import Action


class Slow:
    """An autopilot that answers late."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def __getattr__(self, name: str) -> Any:
        async def answer() -> None:
            await asyncio.sleep(0.01)
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
