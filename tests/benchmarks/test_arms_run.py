"""The bench of the arms' bus once, over a real pty and processes; its numbers are not judged here."""

import asyncio

import pytest

from benchmarks.arms import measure_arms
from benchmarks.targets import arms_targets


@pytest.mark.realtime
async def test_a_run_measures_the_bus_and_the_tick_with_and_without_it() -> None:
    said: list[str] = []
    cost = await asyncio.wait_for(measure_arms(1, 0.5, said.append), 60.0)
    assert cost.cycle_ms.count > 10
    assert cost.cycle_ms.median > 0.0
    assert cost.late_us.count > 10
    assert cost.late_without_us.count > 10
    assert cost.late_us.median < cost.done_us.median
    assert [target.unit for target in arms_targets(cost)] == ["ms", ""]
    assert said == ["turn 1 of 1"]
