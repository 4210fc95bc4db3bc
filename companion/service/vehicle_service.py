"""Construction of the devices and the flight loop from the configuration."""

import asyncio
import math
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from companion.adapters.dynamixel.bus import open_dynamixel
from companion.adapters.law_link.udp import open_law_link
from companion.adapters.mocap.no_frames import NoFrames
from companion.adapters.mocap.source import open_mocap
from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.disk import DiskWatch
from companion.adapters.system.instance_lock import instance_lock
from companion.adapters.system.realtime import spare_the_collector
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.core.interfaces import Clock, OperatorLink, WatchdogTimer
from companion.flight.assembly import Devices, stages_of
from companion.flight.estimate_step import LinkPoses
from companion.flight.flight_loop import FlightLoop
from companion.flight.health_step import Sides
from companion.flight.tick import TickSink
from companion.preflight.checks.check import Check
from companion.preflight.service_facts import Running, preflight
from companion.protocol.check import Tell
from companion.service.flight_actions import DeviceReports, FlightActions
from companion.supervisor.flight_state import Phase

_DISK_S = 2.0


@asynccontextmanager
async def open_service(
    config: CompanionConfig,
    controller: LoadedController,
    sink: TickSink,
    watchdog_timer: WatchdogTimer,
    operator: OperatorLink,
    records: Path | None = None,
) -> AsyncIterator[FlightActions]:
    """Connect the devices and run the flight loop; `records` is the folder whose disk must not be full.

    Raises MocapError, AutopilotError or ArmError when a device cannot be reached, when another service has the
    autopilot, or when the first two devices fail later, and whatever the law raises.
    """
    clock, frames = MonotonicClock(), config.law.onboard_mocap
    async with AsyncExitStack() as devices:
        devices.enter_context(instance_lock(config.px4.url))
        disk = devices.enter_context(DiskWatch(records, _DISK_S))
        mocap = await devices.enter_async_context(open_mocap(config, clock)) if frames else NoFrames()
        autopilot = await devices.enter_async_context(open_px4(config.px4, clock))
        arms = await devices.enter_async_context(open_dynamixel(config.arms, clock)) if config.arms else None
        remarks = arms.warnings if arms is not None else ()
        sides = Sides(operator, disk.free_mb)
        link = await devices.enter_async_context(open_law_link(config, clock)) if config.law.on_ground else None
        poses = None if link is None or frames else LinkPoses(link.end)
        parts = Devices(
            mocap=mocap,
            autopilot=autopilot,
            clock=clock,
            watchdog_timer=watchdog_timer,
            arms=arms,
            sides=sides,
            law_link=link,
            ground_poses=poses,
        )
        loop = FlightLoop(parts, stages_of(parts, controller.law, config), sink, controller.name)
        running = Running(
            mocap=mocap,
            autopilot=autopilot,
            clock=clock,
            estimate=lambda: loop.estimate,
            arms=loop.arms,
            disk_free_mb=disk.free_mb,
            operator_age_s=operator.age_s,
            others=operator.others,
            arms_remarks=remarks,
            landed_age_s=partial(_landed_age_s, loop, clock),
            law_loaded=True,
            law_link=None if link is None else lambda: link.end.status(clock.now_s()),
            ground_poses=poses,
        )

        async def checks(tell: Tell) -> Sequence[Check]:
            return await preflight(replace(running, tell=tell), config)

        spare_the_collector()
        ticking = asyncio.create_task(loop.run(), name="companion.flight_loop")
        try:
            reports = DeviceReports(checks, autopilot.params, (*autopilot.warnings, *remarks))
            yield FlightActions(loop, autopilot, config, ticking, reports)
        finally:
            await loop.close()
            ticking.cancel()
            await asyncio.gather(ticking, return_exceptions=True)


def _landed_age_s(loop: FlightLoop, clock: Clock) -> float:
    """Return the time since this service's last flight ended, s; its arming found both attitudes to agree."""
    return clock.now_s() - loop.flight.since_s if loop.flight.phase is Phase.DISARMED else math.inf
