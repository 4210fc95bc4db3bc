"""Construction of the devices and the flight loop from the configuration."""

import asyncio
import gc
import math
import secrets
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from pathlib import Path

from companion.adapters.dynamixel import open_dynamixel
from companion.adapters.mocap.source import open_mocap
from companion.adapters.mqtt.link import Answering, open_bus
from companion.adapters.px4 import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.disk import DiskWatch
from companion.adapters.system.instance_lock import instance_lock
from companion.config.companion_config import CompanionConfig
from companion.control.controller import Controller
from companion.core.interfaces import Clock, FlightError, OperatorLink, WatchdogTimer
from companion.flight.flight_loop import Devices, FlightLoop
from companion.flight.health_step import Sides
from companion.flight.tick import TickSink
from companion.preflight.service_facts import Running, preflight
from companion.protocol.commands import Command
from companion.service.flight_actions import FlightActions
from companion.service.orders import pass_to_loop
from companion.supervisor.flight_state import Phase

__all__ = ["FlightActions", "open_service"]

_DISK_S = 2.0


@asynccontextmanager
async def open_service(
    config: CompanionConfig,
    law: Controller,
    sink: TickSink,
    watchdog_timer: WatchdogTimer,
    records: Path | None = None,
    operator: OperatorLink | None = None,
) -> AsyncIterator[FlightActions]:
    """Connect the devices and run the flight loop; `records` is the folder whose disk must not be full.

    `operator` is a link whose commands the caller handles; without it the configured one is opened, for commands that
    need no further steps.

    Raises MocapError, AutopilotError or ArmError when a device cannot be reached, when another service has the
    autopilot, or when the first two devices fail later, and whatever the law raises.
    """
    clock, forwarder = MonotonicClock(), _CommandForwarder()
    async with AsyncExitStack() as devices:
        devices.enter_context(instance_lock(config.px4.url))
        disk = devices.enter_context(DiskWatch(records, _DISK_S))
        mocap = await devices.enter_async_context(open_mocap(config, clock))
        autopilot = await devices.enter_async_context(open_px4(config.px4, clock))
        arms = await devices.enter_async_context(open_dynamixel(config.arms, clock)) if config.arms else None
        if operator is None and config.operator is not None:
            listening = open_bus(config.operator, clock, secrets.token_hex(8), forwarder.take)
            operator = await devices.enter_async_context(listening)
        sides = Sides(operator, disk.free_mb)
        loop = FlightLoop(Devices(mocap, autopilot, clock, watchdog_timer, arms, sides), law, config, sink)
        forwarder.loop = loop
        _spare_the_collector()
        ticking = asyncio.create_task(loop.run(), name="companion.flight_loop")
        try:
            operator_age_s = operator.age_s if operator is not None else None
            remarks = arms.warnings if arms is not None else ()
            running = Running(
                mocap=mocap,
                autopilot=autopilot,
                clock=clock,
                estimate=lambda: loop.estimate,
                arms=loop.arms,
                disk_free_mb=disk.free_mb,
                operator_age_s=operator_age_s,
                arms_remarks=remarks,
                landed_age_s=partial(_landed_age_s, loop, clock),
                tell=lambda text: service.report_wait(text),  # noqa: PLW0108 - who is told changes
                law_loaded=True,
            )
            service = FlightActions(
                loop, autopilot, config, ticking, partial(preflight, running, config), autopilot.params
            )
            service.warnings = (*autopilot.warnings, *remarks)
            yield service
        finally:
            await loop.close()
            ticking.cancel()
            await asyncio.gather(ticking, return_exceptions=True)


def _landed_age_s(loop: FlightLoop, clock: Clock) -> float:
    """Return the time since this service's last flight ended, s; its arming found both attitudes to agree."""
    return clock.now_s() - loop.flight.since_s if loop.flight.phase is Phase.DISARMED else math.inf


class _CommandForwarder:
    """Forwarder of commands from the operator's link, which is opened first, to the flight loop."""

    loop: FlightLoop | None = None

    def take(self, command: Command, answer: Answering) -> None:
        """Pass on a command; raise FlightError with the reason when it is refused."""
        if self.loop is None:
            raise FlightError("the service is not ready yet")
        pass_to_loop(self.loop, command, answer)


def _spare_the_collector() -> None:
    """Exempt everything built so far from garbage collection, which would take 50 ms in flight."""
    gc.collect()
    gc.freeze()
