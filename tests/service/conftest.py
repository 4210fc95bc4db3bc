"""Simulated time stands still while a thread plans."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from tests.flights.simulated import SimulatedMocap


@pytest.fixture(autouse=True)
def time_waits_for_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no cycle begin before work in a thread has ended: a flight that spins meanwhile takes the thread's core."""
    to_thread, wait_frame = asyncio.to_thread, SimulatedMocap.wait_frame
    at_work: list[Callable[..., Any]] = []

    async def counted(work: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        at_work.append(work)
        try:
            return await to_thread(work, *arguments, **named)
        finally:
            at_work.remove(work)

    async def waiting(self: SimulatedMocap, timeout_s: float) -> bool:
        while at_work:  # noqa: ASYNC110 - the thread's own future belongs to who awaits it
            await asyncio.sleep(0.001)
        return await wait_frame(self, timeout_s)

    monkeypatch.setattr(asyncio, "to_thread", counted)
    monkeypatch.setattr(SimulatedMocap, "wait_frame", waiting)
