"""Observation of a vehicle: reads all devices and estimates as in flight, and cannot command anything.

At most it forwards poses to the autopilot's estimator, as a service does while the vehicle stands.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from companion.adapters.dynamixel.bus import DynamixelBus, open_dynamixel
from companion.adapters.mocap.no_frames import NoFrames
from companion.adapters.mocap.source import open_mocap
from companion.adapters.px4.link import open_px4
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.disk import DiskWatch
from companion.adapters.system.instance_lock import instance_lock
from companion.config.arms_config import ArmsConfig
from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import Clock, CompanionError, ConfigError, GroundPoses, MocapError, MocapSource
from companion.core.types import NOT_HEARD, AutopilotStatus, MocapFrame
from companion.estimation.estimator import EstimatorState
from companion.flight.arm_step import ArmStep
from companion.flight.assembly import arms_of, estimate_of, period_s
from companion.flight.estimate_step import EstimateStep
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
        estimating: EstimateStep,
        status: Callable[[], AutopilotStatus] = lambda: NOT_HEARD,
        arms: ArmStep | None = None,
        vision: VisionStep | None = None,
    ) -> None:
        self._mocap, self._clock, self._arms, self._vision = mocap, clock, arms, vision
        self._estimating, self._status = estimating, status
        self.frame: MocapFrame | None = None
        self.each: Callable[[float, float], None] | None = None

    async def run(self) -> None:
        """Run until cancelled; raises the error of motion capture when its connection is lost."""
        while True:
            await self._mocap.wait_frame(_DEADLINE_S)
            now_s = self._clock.now_s()
            received_s = self._read(now_s)
            if self._arms is not None:
                self._arms.read(now_s, FlightState())
            if self.each is not None:
                self.each(now_s, received_s)

    @property
    def estimate(self) -> EstimatorState:
        """Newest estimate of the vehicle's motion."""
        return self._estimating.state

    def _read(self, now_s: float) -> float:
        """Take what is new, and return the frame's arrival (s), NaN without one."""
        arrival = self._estimating.read(self._status())
        self.frame = arrival.frame or self.frame
        if self._vision is not None:
            self._vision.forward(now_s, arrival.is_new, self._estimating.for_vision(now_s))
        return arrival.frame_received_s


class _NoPoses:
    """GroundPoses of a vehicle to which nobody sends any."""

    def latest_pose(self) -> None:
        return None


def require_frames(config: CompanionConfig) -> None:
    """Raise ConfigError on a vehicle that motion capture's frames do not reach."""
    if not config.law.onboard_mocap:
        raise ConfigError(
            "this needs motion capture, whose frames do not reach the vehicle (law.onboard_mocap = false): do it with "
            "a configuration that has law.onboard_mocap = true, on a computer that the frames reach"
        )


@asynccontextmanager
async def open_live_observer(
    config: CompanionConfig,
    records: Path,
    forward_vision: bool,
    tell: Tell = lambda _: None,
    ground: GroundPoses | None = None,
) -> AsyncIterator[tuple[Running, LiveObserver]]:
    """Connect and read all devices; `records` is the folder whose disk is checked.

    Where frames do not reach the vehicle, motion capture is left out, and the poses are those of `ground`.

    Raises DevicesMissingError, after all were tried, when a device cannot be reached, AutopilotError when a service has
    the autopilot, and MocapError when motion capture fails later. Servos that are missing or at fault show in
    `Running.arms`.
    """
    clock = MonotonicClock()
    poses = None if config.law.onboard_mocap else ground or _NoPoses()
    async with AsyncExitStack() as devices:
        devices.enter_context(instance_lock(config.px4.url))
        opening = DeviceOpening(devices, tell)
        where = f"on {config.px4.url}, for up to {config.px4.connect_timeout_s:g} s"
        mocap, autopilot, bus = await asyncio.gather(
            _opened_mocap(opening, config, clock),
            opening.device("autopilot", where, open_px4(config.px4, clock)),
            _opened_arms(opening, config.arms, clock),
        )
        if mocap is None or autopilot is None or (bus is None and config.arms is not None):
            seen = () if mocap is None or poses is not None else await _mocap_checks(mocap, clock, config)
            raise DevicesMissingError(opening.checks, seen)
        arms = arms_of(config, bus)  # it reads only, and never moves them
        disk = devices.enter_context(DiskWatch(records, _DISK_S))
        vision = VisionStep(autopilot, config.px4.vision_rate_hz, period_s(config)) if forward_vision else None
        observer = LiveObserver(mocap, clock, estimate_of(config, mocap, poses), autopilot.status, arms, vision)
        running = Running(
            mocap=mocap,
            autopilot=autopilot,
            clock=clock,
            estimate=lambda: observer.estimate,
            arms=arms,
            disk_free_mb=disk.free_mb,
            arms_remarks=bus.warnings if bus is not None else (),
            ground_poses=poses,
        )
        async with _kept_going(observer):
            yield running, observer


async def _opened_mocap(opening: DeviceOpening, config: CompanionConfig, clock: Clock) -> MocapSource | None:
    if not config.law.onboard_mocap:
        return NoFrames()
    return await opening.device("motion capture", mocap_place(config), open_mocap(config, clock))


async def _opened_arms(opening: DeviceOpening, arms: ArmsConfig | None, clock: Clock) -> DynamixelBus | None:
    if arms is None:
        return None
    return await opening.device("arms", f"on {arms.port}", open_dynamixel(arms, clock, strict=False))


@asynccontextmanager
async def open_mocap_observer(config: CompanionConfig) -> AsyncIterator[tuple[LiveObserver, MocapWatch]]:
    """Connect and read motion capture alone; MocapError when it cannot be reached, or fails later."""
    clock = MonotonicClock()
    async with open_mocap(config, clock) as mocap:
        observer = LiveObserver(mocap, clock, estimate_of(config, mocap, None))
        watch = MocapWatch(mocap, lambda: observer.estimate, config.mocap.delay_s)
        async with _kept_going(observer):
            yield observer, watch


async def _mocap_checks(mocap: MocapSource, clock: Clock, config: CompanionConfig) -> tuple[Check, ...]:
    """Return the mocap checks from a short observation, used when other devices are missing."""
    observer = LiveObserver(mocap, clock, estimate_of(config, mocap, None))
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
