"""Shared fixtures: no task may outlive its test."""

import asyncio
from collections.abc import AsyncIterator

import hypothesis
import pytest
import pytest_asyncio

# Examples are timed by the wall clock, and these machines are shared: a slow moment is no defect.
hypothesis.settings.register_profile("patient", deadline=None)
hypothesis.settings.load_profile("patient")


@pytest_asyncio.fixture(autouse=True)
async def no_task_outlives_its_test() -> AsyncIterator[None]:
    """Fail a test that leaves a task running on its event loop."""
    before = asyncio.all_tasks()
    yield
    await asyncio.sleep(0)
    left = [task for task in asyncio.all_tasks() - before if task is not asyncio.current_task() and not task.done()]
    if left:
        names = sorted(f"{task.get_name()} ({task.get_coro()})" for task in left)
        for task in left:
            task.cancel()
        pytest.fail(f"tasks outlived the test: {', '.join(names)}")
