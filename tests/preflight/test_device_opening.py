"""Devices that are opened at the same time: none waits for another, and each is left in the task that entered it."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from companion.core.interfaces import AutopilotError, ConfigError, MocapError
from companion.preflight.device_opening import DeviceOpening


class Door:
    """A device that opens, or fails, when it is told to."""

    def __init__(self, name: str, error: Exception | None = None) -> None:
        self.name, self._error = name, error
        self.goes_on = asyncio.Event()
        self.tasks: list[asyncio.Task[None] | None] = []
        self.closed = False

    @asynccontextmanager
    async def open(self) -> AsyncIterator[str]:
        self.tasks.append(asyncio.current_task())
        await self.goes_on.wait()
        if self._error is not None:
            raise self._error
        try:
            yield self.name
        finally:
            self.tasks.append(asyncio.current_task())
            self.closed = True


async def turn() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


async def test_what_is_missing_is_told_while_another_is_still_waited_for() -> None:
    mocap, autopilot, told = Door("mocap", MocapError("no bridge was ever there")), Door("px4"), list[str]()
    async with AsyncExitStack() as stack:
        opening = DeviceOpening(stack, told.append)
        both = asyncio.gather(
            opening.device("motion capture", "over MQTT", mocap.open()),
            opening.device("autopilot", "on udpin, for up to 10 s", autopilot.open()),
        )
        await turn()
        assert told[-1] == "connecting to motion capture over MQTT, autopilot on udpin, for up to 10 s"
        mocap.goes_on.set()
        await turn()
        first, second = told[-1].splitlines()
        assert first == "motion capture: no bridge was ever there"
        assert second == "connecting to autopilot on udpin, for up to 10 s"
        autopilot.goes_on.set()
        assert list(await both) == [None, "px4"]
        assert [(check.name, check.passed) for check in opening.checks] == [
            ("motion capture", False),
            ("autopilot", True),
        ]
        assert len(autopilot.tasks) == 1, "it is kept until the stack ends"
    assert autopilot.closed
    entered, left = autopilot.tasks
    assert entered is left, "a task group, or a time-out, that is open in a device allows nothing else"
    assert entered is not asyncio.current_task()


async def test_the_checks_stand_in_the_order_in_which_the_devices_were_asked_for() -> None:
    doors = [Door("mocap", MocapError("no QTM")), Door("px4", AutopilotError("no PX4"))]
    async with AsyncExitStack() as stack:
        opening = DeviceOpening(stack, lambda _: None)
        both = asyncio.gather(
            opening.device("motion capture", "", doors[0].open()), opening.device("autopilot", "", doors[1].open())
        )
        for door in reversed(doors):
            door.goes_on.set()
            await turn()
        assert list(await both) == [None, None]
    assert [(check.name, check.says) for check in opening.checks] == [
        ("motion capture", "no QTM"),
        ("autopilot", "no PX4"),
    ]
    assert all(check.todo for check in opening.checks)


@pytest.mark.parametrize("ended_by", ["a mistake in the configuration", "Ctrl-C"])
async def test_whatever_ends_the_opening_ends_what_is_still_being_opened(ended_by: str) -> None:
    wrong, slow = Door("mocap", ConfigError("no such password file")), Door("px4")

    async def opened() -> None:
        async with AsyncExitStack() as stack:
            opening = DeviceOpening(stack, lambda _: None)
            await asyncio.gather(
                opening.device("motion capture", "", wrong.open()), opening.device("autopilot", "", slow.open())
            )

    task = asyncio.create_task(opened())
    await turn()
    if ended_by == "Ctrl-C":
        task.cancel()
    else:
        wrong.goes_on.set()
    with pytest.raises(asyncio.CancelledError if ended_by == "Ctrl-C" else ConfigError):
        await task
    await turn()
    assert all(entered is not None and entered.done() for entered in (*wrong.tasks, *slow.tasks))


async def test_what_fails_when_a_device_is_closed_is_raised() -> None:
    @asynccontextmanager
    async def bad() -> AsyncIterator[str]:
        yield "px4"
        raise AutopilotError("it cannot be closed")

    with pytest.raises(AutopilotError, match="it cannot be closed"):
        async with AsyncExitStack() as stack:
            assert await DeviceOpening(stack, lambda _: None).device("autopilot", "", bad()) == "px4"
