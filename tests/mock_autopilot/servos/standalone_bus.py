"""The servo bus without a vehicle: its servos follow the wall clock, with no load but `load_nm`."""

import asyncio
import contextlib
import time

from mock_autopilot.servos.bus import ServoBus
from mock_autopilot.servos.config import DynamixelConfig

STEP_S = 0.002
"""Physics at 500 Hz of simulated time."""
LONGEST_CATCH_UP_S = 1.0
"""After a longer pause simulated time skips the pause."""


class StandaloneBus:
    """A `ServoBus` that steps itself; use `async with`."""

    def __init__(self, config: DynamixelConfig | None = None) -> None:
        self.bus = ServoBus(config or DynamixelConfig(), self.catch_up)
        self.load_nm: tuple[float, ...] = (0.0,) * len(self.bus.servos.servos)
        """Load on each servo, positive towards greater angles."""
        self._boot_s = 0.0
        self._steps = 0
        self._running: asyncio.Task[None] | None = None

    @property
    def path(self) -> str:
        """Return the path that the host opens."""
        return self.bus.path

    async def __aenter__(self) -> "StandaloneBus":
        self.bus.open()
        self._boot_s = time.monotonic()
        self._running = asyncio.create_task(self._run(), name="tests.servos")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._running is not None:
            self._running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._running
        self.bus.close()

    def catch_up(self) -> None:
        """Bring the servos to the present."""
        behind_s = time.monotonic() - self._boot_s - self._steps * STEP_S
        if behind_s > LONGEST_CATCH_UP_S:
            self._boot_s += behind_s - LONGEST_CATCH_UP_S
        while (self._steps + 1) * STEP_S <= time.monotonic() - self._boot_s:
            self._steps += 1
            self.bus.servos.step(STEP_S, self.load_nm)

    async def _run(self) -> None:
        while True:
            self.catch_up()
            await asyncio.sleep(0.01)
