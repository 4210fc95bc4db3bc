"""Devices opened at the same time: one that is missing holds up no other, and is told as soon as it is known."""

import asyncio
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from typing import Any, TypeVar

from companion.core.interfaces import ArmError, AutopilotError, MocapError
from companion.preflight.checks.check import Check

Device = TypeVar("Device")
Tell = Callable[[str], None]
"""Shows what is waited for, and what is missing already."""

TODO = {
    "motion capture": "start QTM's measurement with its real-time output; look at mocap.host, port and body, or at the "
    "bridge if mocap.source is mqtt",
    "autopilot": "look at the cable, px4.url and PX4's power",
    "arms": "look at the servos' power and at arms.port; then `companion arms ping`",
}
"""Remedy where a device cannot be reached, by its name."""


class DeviceOpening:
    """Opens devices at the same time and keeps them until the stack ends; one `Check` each, in the order of opening."""

    def __init__(self, devices: AsyncExitStack, tell: Tell) -> None:
        self._devices, self._tell = devices, tell
        self._waiting: dict[str, str] = {}
        """By name, where."""
        self._checks: dict[str, Check | None] = {}

    @property
    def checks(self) -> tuple[Check, ...]:
        """One a device that has been reached or not."""
        return tuple(check for check in self._checks.values() if check is not None)

    async def device(self, name: str, where: str, opening: AbstractAsyncContextManager[Device]) -> Device | None:
        """Return the device, or None when it cannot be reached."""
        self._waiting[name], self._checks[name] = where, None
        self._show()
        try:
            device = await self._held(name, opening)
        except (MocapError, AutopilotError, ArmError) as error:
            self._checks[name] = Check(name, False, str(error), TODO[name])
            return None
        else:
            self._checks[name] = Check(name, True, "reached")
            return device
        finally:
            del self._waiting[name]
            self._show()

    async def _held(self, name: str, opening: AbstractAsyncContextManager[Device]) -> Device:
        """Enter a context in a task of its own, which leaves it when the stack ends: both must be in one task."""
        opened: asyncio.Future[Device] = asyncio.get_running_loop().create_future()
        release = asyncio.Event()
        holding = asyncio.create_task(_hold(opening, opened, release), name=f"companion.{name.replace(' ', '_')}")

        async def end() -> None:
            release.set()
            if not opened.done():
                holding.cancel()
            await asyncio.wait([holding])
            if not holding.cancelled():
                holding.result()

        self._devices.push_async_callback(end)
        either: list[asyncio.Future[Any]] = [opened, holding]
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if not opened.done():
            holding.result()  # cancelled from elsewhere
        return opened.result()

    def _show(self) -> None:
        missing = [f"{check.name}: {check.says}" for check in self.checks if not check.passed]
        waiting = ", ".join(f"{name} {where}" for name, where in self._waiting.items())
        self._tell("\n".join([*missing, *([f"connecting to {waiting}"] if waiting else [])]))


async def _hold(
    opening: AbstractAsyncContextManager[Device], opened: "asyncio.Future[Device]", release: asyncio.Event
) -> None:
    try:
        async with opening as device:
            opened.set_result(device)
            await release.wait()
    except Exception as error:
        if opened.done():
            raise
        opened.set_exception(error)
