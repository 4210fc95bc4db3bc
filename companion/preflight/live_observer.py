"""Observation of a vehicle: reads all devices and estimates as in flight, and cannot command anything.

At most it forwards poses to the autopilot's estimator, as a service does while the vehicle stands.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from companion.adapters.dynamixel.bus import DynamixelBus, open_dynamixel
from companion.adapters.mocap.source import open_mocap
from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.disk import DiskWatch
from companion.adapters.system.instance_lock import instance_lock
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import Clock, CompanionError, MocapError, MocapSource
from companion.core.types import MocapFrame
from companion.estimation import estimator
from companion.estimation.estimator import EstimatorParams, EstimatorState
from companion.flight.arm_step import ArmStep
from companion.flight.assembly import arms_of, estimator_of, period_s
from companion.flight.vision_step import VisionStep
from companion.preflight.checks.all_checks import check_mocap
from companion.preflight.checks.check import Check
from companion.preflight.checks.mocap import MocapWatch
from companion.preflight.device_opening import TODO, DeviceOpening, Tell
from companion.preflight.service_facts import Running
from companion.supervisor.flight_state import FlightState

_DEADLINE_S = 0.02
"""A cycle begins without a frame, too."""
_DISK_S = 5.0
_LOOK_S = 1.0
"""Observation of motion capture when another device is missing."""


class DevicesMissingError(CompanionError):
    """Not every device can be reached; `checks` has a line for each that was looked for, and for motion capture."""

    def __init__(self, devices: tuple[Check, ...], of_mocap: tuple[Check, ...]) -> None:
        sentences = [check.says for check in devices if not check.passed]
        if of_mocap:
            sentences.append("motion capture is there: `companion mocap` shows it without the rest")
        super().__init__("\n".join(sentences))
        self.checks = (*devices, *of_mocap)


class LiveObserver:
    """Observer that runs one cycle per frame; `each` gets its time and the frame's arrival, NaN without one."""

    def __init__(
        self,
        mocap: MocapSource,
        clock: Clock,
        params: EstimatorParams,
        arms: ArmStep | None = None,
        vision: VisionStep | None = None,
    ) -> None:
        self._mocap, self._clock, self._arms, self._vision = mocap, clock, arms, vision
        self._params = params
        self.estimate = EstimatorState()
        self.frame: MocapFrame | None = None
        self.each: Callable[[float, float], None] | None = None

    async def run(self) -> None:
        """Run until cancelled; raises the error of motion capture when its connection is lost."""
        while True:
            fresh = await self._mocap.wait_frame(_DEADLINE_S)
            now_s = self._clock.now_s()
            received_s = self._read(now_s) if fresh else math.nan
            if self._arms is not None:
                self._arms.read(now_s, FlightState())
            if self.each is not None:
                self.each(now_s, received_s)

    def _read(self, now_s: float) -> float:
        frame = self._mocap.latest()
        if frame is None:
            return math.nan
        self.frame = frame
        self.estimate = estimator.step(self.estimate, frame, self._params)
        if self._vision is not None:
            self._vision.forward(now_s, True, self.estimate)
        return frame.received_s


@asynccontextmanager
async def open_live_observer(
    config: CompanionConfig, records: Path, forward_vision: bool, tell: Tell = lambda _: None
) -> AsyncIterator[tuple[Running, LiveObserver]]:
    """Connect and read all devices; `records` is the folder whose disk is checked.

    Raises DevicesMissingError, after all were tried, when a device cannot be reached, AutopilotError when a service has
    the autopilot, and MocapError when motion capture fails later. Servos that are missing or at fault show in
    `Running.arms`.
    """
    clock = MonotonicClock()
    async with AsyncExitStack() as devices:
        devices.enter_context(instance_lock(config.px4.url))
        opening = DeviceOpening(devices, tell)
        where = f"on {config.px4.url}, for up to {config.px4.connect_timeout_s:g} s"
        mocap, autopilot, bus = await asyncio.gather(
            opening.device("motion capture", mocap_place(config), open_mocap(config, clock)),
            opening.device("autopilot", where, open_px4(config.px4, clock)),
            _opened_arms(opening, config.arms, clock),
        )
        if mocap is None or autopilot is None or (bus is None and config.arms is not None):
            seen = () if mocap is None else await _mocap_checks(mocap, clock, config)
            raise DevicesMissingError(opening.checks, seen)
        arms = arms_of(config, bus)  # it reads only, and never moves them
        disk = devices.enter_context(DiskWatch(records, _DISK_S))
        vision = VisionStep(autopilot, config.px4.vision_rate_hz, period_s(config)) if forward_vision else None
        observer = LiveObserver(mocap, clock, estimator_of(config), arms, vision)
        running = Running(
            mocap=mocap,
            autopilot=autopilot,
            clock=clock,
            estimate=lambda: observer.estimate,
            arms=arms,
            disk_free_mb=disk.free_mb,
            arms_remarks=bus.warnings if bus is not None else (),
        )
        async with _kept_going(observer):
            yield running, observer


async def _opened_arms(opening: DeviceOpening, arms: ArmsConfig | None, clock: Clock) -> DynamixelBus | None:
    if arms is None:
        return None
    return await opening.device("arms", f"on {arms.port}", open_dynamixel(arms, clock, strict=False))


@asynccontextmanager
async def open_mocap_observer(config: CompanionConfig) -> AsyncIterator[tuple[LiveObserver, MocapWatch]]:
    """Connect and read motion capture alone; MocapError when it cannot be reached, or fails later."""
    clock = MonotonicClock()
    async with open_mocap(config, clock) as mocap:
        observer = LiveObserver(mocap, clock, estimator_of(config))
        watch = MocapWatch(mocap, lambda: observer.estimate, config.mocap.delay_s)
        async with _kept_going(observer):
            yield observer, watch


async def _mocap_checks(mocap: MocapSource, clock: Clock, config: CompanionConfig) -> tuple[Check, ...]:
    """Return the mocap checks from a short observation, used when other devices are missing."""
    observer = LiveObserver(mocap, clock, estimator_of(config))
    watch = MocapWatch(mocap, lambda: observer.estimate, config.mocap.delay_s)
    observer.each = lambda now_s, _: watch.look(now_s)
    begun_s = clock.now_s()
    try:
        async with _kept_going(observer):
            await asyncio.sleep(_LOOK_S)
    except MocapError as error:
        return (Check("motion capture", False, str(error), TODO["motion capture"]),)
    return check_mocap(watch.seen(config.mocap.body, clock.now_s() - begun_s), config.safety, config.preflight)


def mocap_place(config: CompanionConfig) -> str:
    """Return where motion capture comes from, for a sentence."""
    if config.mocap.source == "mqtt":
        broker = config.mocap_broker()
        return f"over MQTT, {broker.host}:{broker.port}"
    return f"at {config.mocap.host}:{config.mocap.port}"


@asynccontextmanager
async def _kept_going(observer: LiveObserver) -> AsyncIterator[None]:
    """Run the observer beside the body; its error ends the body's wait with the same error."""
    try:
        async with asyncio.TaskGroup() as group:
            looking = group.create_task(observer.run(), name="companion.observer")
            yield
            looking.cancel()
    except BaseExceptionGroup as errors:
        raise errors.exceptions[0] from None
