"""Shared fixtures: no task may outlive its test."""

import asyncio
import signal
from collections.abc import AsyncIterator

import hypothesis
import pytest
import pytest_asyncio

# A run begun in the background is deaf to Ctrl-C, and so would be every command that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

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
