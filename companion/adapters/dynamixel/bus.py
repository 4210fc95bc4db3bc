"""Non-blocking interface of the arms' servo bus."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from companion.adapters.dynamixel.bus_thread import BusThread
from companion.adapters.dynamixel.inspection import Inspected
from companion.adapters.dynamixel.orders import Goals
from companion.adapters.dynamixel.torque import Steps
from companion.arms.model import JOINT_COUNT
from companion.config.arms_config import ArmsConfig
from companion.core.interfaces import ArmError, Clock
from companion.core.types import ArmStatus, Array

TORQUE_TIMEOUT_S = 3.0
CLEAR_TIMEOUT_S = 20.0
"""Eight servos that have to reboot one after the other."""


@asynccontextmanager
async def open_dynamixel(config: ArmsConfig, clock: Clock, strict: bool = True) -> AsyncIterator["DynamixelBus"]:
    """Open the port, look at every servo, start cycling, and yield the bus.

    Raises one ArmError that names all that is missing or wrong; not `strict`, for looking, letting go and clearing,
    only when no servo answers: what else is missing or in error then begins as a latched fault. Nothing is changed in
    the servos by connecting. On leaving, the port is closed and the torque stays as it is, on or off: arms that go
    limp in the air are a danger; call `torque_off` to release them.
    """
    bus_thread = BusThread(config, clock, strict)
    bus_thread.start()
    try:
        await bus_thread.connected
        yield DynamixelBus(bus_thread)
    finally:
        await bus_thread.close()


class DynamixelBus:
    """ArmBus interface over dynamixel-sdk; made by `open_dynamixel`."""

    def __init__(self, bus_thread: BusThread) -> None:
        self._bus_thread = bus_thread

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about what works but should be better: the adapter's latency timer and name, servos' settings."""
        return self._bus_thread.warnings

    @property
    def inspected(self) -> Inspected:
        """Settings and faults of every servo, as read while connecting."""
        return self._bus_thread.inspected

    def status(self) -> ArmStatus:
        """Return the last known state; never waits."""
        return self._bus_thread.status

    def move(self, position_rad: Array) -> None:
        """Take new goals, (8,); never waits, the latest wins.

        A faulty or limp joint ignores its own, NaN leaves a joint where it is going. Goals are kept inside the joint
        limits and approached no faster than the joint may move. ValueError for another shape.
        """
        if position_rad.shape != (JOINT_COUNT,):
            raise ValueError(f"goals must have the shape ({JOINT_COUNT},), not {position_rad.shape}")
        self._bus_thread.goals = Goals(tuple(position_rad.tolist()))

    def hold(self) -> None:
        """Bring every joint's goals to rest from the last ones that were sent; never waits. Torque stays on.

        Goals that stand stay: a loaded joint does not creep, a claw keeps its grip.
        """
        goals = self._bus_thread.goals
        if goals is None or goals.position_rad is not None:
            self._bus_thread.goals = Goals()

    async def torque_on(self) -> None:
        """Hold every joint where it is, without a jump; ArmError naming the joints that refuse.

        While any fault is latched, none is switched on. Goals given before do not count.
        """
        await self._done("torque on", self._bus_thread.switch_on, TORQUE_TIMEOUT_S)

    async def torque_off(self) -> None:
        """Let every joint go limp; ArmError naming the joints that do not answer."""
        await self._done("torque off", self._bus_thread.switch_off, TORQUE_TIMEOUT_S)

    async def clear_faults(self) -> None:
        """Forget latched faults, rebooting XMs with a hardware error and reopening a lost port.

        What was at fault has no torque afterwards, until `torque_on`. ArmError naming what is still wrong.
        """
        await self._done("clear faults", self._bus_thread.clear, CLEAR_TIMEOUT_S)

    async def _done(self, what: str, begin: Callable[[], Steps], timeout_s: float) -> None:
        command = self._bus_thread.commands.submit(begin)
        try:
            async with asyncio.timeout(timeout_s):
                await command.done
        except TimeoutError as error:
            raise ArmError(f"the arms' bus did not finish '{what}' within {timeout_s:g} s") from error
        finally:
            command.abandoned = True
