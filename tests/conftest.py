"""Shared fixtures: no task may outlive its test."""

import asyncio
import gc
import inspect
import os
import signal
from collections.abc import AsyncIterator

import hypothesis
import pytest
import pytest_asyncio

from tests import packages

# A run begun in the background is deaf to Ctrl-C, and so would be every command that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Flights keep tens of thousands of values, none of them garbage: looking through them again and again takes 5 %.
gc.set_threshold(20_000, 20, 20)

# Examples have no deadline: machines are shared, and a slow moment is no defect.
# `fixed` draws the same examples on every run, so that a change is judged by what it changed; `make fuzz` draws others;
# `few` is for `make coverage`, which only asks whether a line was reached.
hypothesis.settings.register_profile("fixed", deadline=None, derandomize=True, database=None)
hypothesis.settings.register_profile("few", deadline=None, derandomize=True, database=None, max_examples=10)
hypothesis.settings.register_profile("fuzz", deadline=None, print_blob=True, max_examples=1000)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


_PASSES_TO_END = 5
"""Passes of the event loop that a cancelled task needs to end: aiomqtt does not await its own as a client closes."""
ALONE = ("tests/flights", "tests/page", "tests/benchmarks")
"""Folders whose tests in real time are run one after the other."""


def runs_alone(path: str) -> bool:
    """Return True for a file whose tests in real time want most of the computer."""
    return any(alone in path for alone in ALONE)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what needs the computer for itself, flights and the page's browser, so that `make test` runs it in turn.

    Processes side by side begin with what computes for long, so that they end at the same time.
    """
    for item in items:
        if runs_alone(item.path.as_posix()):
            item.add_marker("flight")
        if isinstance(item, pytest.Function) and inspect.iscoroutinefunction(item.function):
            item.fixturenames.append(no_task_outlives_its_test.__name__)  # a loop costs each of 5,000 others 2 ms
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: item.get_closest_marker("slow") is None)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test whose programs are not installed; in CI, where they must be, fail it."""
    programs = tuple(name for mark in item.iter_markers("needs") for name in mark.args)
    missing = packages.missing_packages(programs)
    if missing:
        reason = packages.SKIPPED + " ".join(missing)
        if os.environ.get("CI") and not os.environ.get(packages.HIDE):
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)


@pytest_asyncio.fixture
async def no_task_outlives_its_test() -> AsyncIterator[None]:
    """Fail a test that leaves a task running on its event loop."""
    before = asyncio.all_tasks()
    yield
    for _ in range(_PASSES_TO_END):
        await asyncio.sleep(0)
    left = [task for task in asyncio.all_tasks() - before if task is not asyncio.current_task() and not task.done()]
    if left:
        names = sorted(f"{task.get_name()} ({task.get_coro()})" for task in left)
        for task in left:
            task.cancel()
        pytest.fail(f"tasks outlived the test: {', '.join(names)}")
