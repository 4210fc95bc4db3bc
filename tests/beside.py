"""Tests that mostly wait, beside each other: the first of a module lets all begin that were chosen, each tells its end.

    beside = Beside(at_once=4)

    @beside
    async def test_something() -> None: ...

For tests without fixtures that share nothing but the event loop, and measure no times that a busy one would spoil.
"""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

Test = Callable[[], Awaitable[None]]


class Beside:
    """The tests of one module that run side by side."""

    def __init__(self, at_once: int) -> None:
        self._at_once = at_once
        self._tests: dict[str, Test] = {}
        self._ends: dict[str, BaseException | None] = {}

    def __call__(self, test: Test) -> Callable[[pytest.FixtureRequest], Awaitable[None]]:
        """Register a test function of this module; return it unchanged."""
        name = test.__name__
        self._tests[name] = test

        async def among_others(request: pytest.FixtureRequest) -> None:
            if name not in self._ends:
                await self._run(_chosen_in(request))
            end = self._ends.pop(name)
            if end is not None:
                raise end

        among_others.__name__, among_others.__qualname__ = name, test.__qualname__
        among_others.__module__, among_others.__doc__ = test.__module__, test.__doc__
        return among_others

    async def _run(self, chosen: set[str]) -> None:
        names, turn = [name for name in self._tests if name in chosen], asyncio.Semaphore(self._at_once)

        async def run(test: Test) -> None:
            async with turn:
                await test()

        ends = await asyncio.gather(*(run(self._tests[name]) for name in names), return_exceptions=True)
        self._ends = dict(zip(names, ends, strict=True))


def _chosen_in(request: pytest.FixtureRequest) -> set[str]:
    """Names of the tests of this module that are to be run."""
    return {item.name for item in request.session.items if item.path == request.path}
