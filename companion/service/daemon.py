"""Daemon: the operators' bus, and a vehicle whenever its devices are connected."""

import asyncio
import logging
import secrets
import signal
import sys
import time
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from companion.adapters.broker.process import open_broker
from companion.adapters.mqtt.link import BusLink
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.last_resort import LastResort
from companion.adapters.system.realtime import SWITCH_INTERVAL_S
from companion.adapters.system.systemd import Notifier
from companion.adapters.system.watchdog_timer import KernelWatchdogTimer
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import ArmError, CompanionError, ConfigError, MocapError
from companion.flight.sinks import FanOutSink, LoopHeartbeat
from companion.flight.tick import TickSink
from companion.preflight.live_observer import DevicesMissingError, open_live_observer
from companion.records.record_process import RecordSink
from companion.service.about import about_of
from companion.service.dispatcher import CommandDispatcher
from companion.service.flight_actions import FlightActions
from companion.service.publishing import STATE_S, CommandLogger, EventPublisher, StatePublisher
from companion.service.telemetry import Telemetry
from companion.service.traffic import Traffic
from companion.service.vehicle_service import open_service
from companion.supervisor.flight_state import STREAMING, Phase
from companion.supervisor.without_frames import off_sentence

LOG = logging.getLogger(__name__)

_RETRY_S = 2.0
"""Time between two attempts to connect to the devices."""
_RIVAL_TIMEOUT_S = 3.0
"""Time to wait for the broker's report of another service with this vehicle's name."""
_TICK_TIMEOUT_S = 0.5
"""Age of the newest tick below which the control loop counts as alive."""
_LANDING_S = 60.0


@dataclass(frozen=True, kw_only=True)
class DaemonSettings:
    """Configuration, law and process-wide devices of the daemon."""

    config: CompanionConfig
    controller: LoadedController
    notifier: Notifier
    recorder: RecordSink | None
    records: Path | None
    note_law: Callable[[str], None]
    """Called with the name of every law before it flies."""
    last_resort: LastResort

    @property
    def operator(self) -> OperatorConfig:
        """Settings of the bus; without an [operator] table an embedded broker for this computer only."""
        return self.config.operator or OperatorConfig(embedded=True)


async def serve(settings: DaemonSettings) -> None:
    """Run until SIGTERM or Ctrl-C, landing first; raise ConfigError for invalid settings of the broker."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    stop = asyncio.Event()
    _end_on_signals(stop, settings)
    asyncio.get_running_loop().set_exception_handler(partial(_failed_callback, settings.last_resort))
    session = secrets.token_hex(8)
    async with AsyncExitStack() as devices:
        if settings.operator.embedded:
            await devices.enter_async_context(open_broker(settings.operator))
        link = BusLink(settings.operator, MonotonicClock(), session, about_of(settings.config, session))
        separation, body, rules = settings.config.separation, settings.config.mocap.body, settings.config.flight_rules()
        traffic = Traffic(separation, body, session, link.announce, link.neighbours.intents, rules)
        dispatcher = CommandDispatcher(settings.config, settings.note_law, link.rival, traffic)
        publisher = EventPublisher(link, settings.recorder)
        await devices.enter_async_context(link.listening(CommandLogger(dispatcher, publisher)))
        await _require_only_service(link)
        telemetry, heartbeat = Telemetry(session, publisher), LoopHeartbeat()
        states = StatePublisher(
            link=link,
            telemetry=telemetry,
            dispatcher=dispatcher,
            rate_hz=settings.config.control.rate_hz,
            off="" if settings.config.law.onboard_mocap else off_sentence(),
        )
        publishing = asyncio.create_task(_publish_state(states, heartbeat, settings), name="companion.state")
        try:
            settings.notifier.ready("looking for the vehicle")
            sinks: list[TickSink] = [heartbeat, telemetry, *([settings.recorder] if settings.recorder else [])]
            await _serve_vehicles(settings, FanOutSink(sinks), link, dispatcher, telemetry, stop)
        finally:
            if not stop.is_set():
                settings.notifier.stopping("ends")
            publishing.cancel()
            await asyncio.gather(publishing, return_exceptions=True)


async def _require_only_service(link: BusLink) -> None:
    """Raise ConfigError when another service uses this vehicle's name; without a broker this cannot be known."""
    await link.listened(_RIVAL_TIMEOUT_S)
    if link.rival():
        raise ConfigError(link.rival())


def _end_on_signals(stop: asyncio.Event, settings: DaemonSettings) -> None:
    def end() -> None:
        settings.last_resort.begin_deadline()
        again = stop.is_set()
        stop.set()  # first: the calls below need memory, which may be exhausted
        LOG.warning("told to end%s", ": already ending" if again else "")
        if not again:
            settings.notifier.stopping("told to end")

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, end)


def _failed_callback(last_resort: LastResort, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    if isinstance(context.get("exception"), MemoryError):
        last_resort.lacks_memory()
    loop.default_exception_handler(context)


async def _serve_vehicles(
    settings: DaemonSettings,
    sink: TickSink,
    link: BusLink,
    dispatcher: CommandDispatcher,
    telemetry: Telemetry,
    stop: asyncio.Event,
) -> None:
    """Serve the vehicle; reconnect on the ground, or while its pilot flies, whenever its devices were lost.

    Raises ConfigError for what no next attempt would mend, such as a port of the law's link that is in use.
    """
    watchdog_timer, said = KernelWatchdogTimer(settings.config.safety.dead_man_s), ""
    while not stop.is_set():
        opened = asyncio.Event()

        async def one_vehicle(opened: asyncio.Event = opened) -> None:
            async with open_service(
                settings.config, settings.controller, sink, watchdog_timer, link, settings.records
            ) as service:
                opened.set()
                settings.last_resort.flying = partial(_depends_on_process, service)
                await _with_vehicle(service, dispatcher, stop)

        try:
            await begun_unless(stop, opened, one_vehicle())
        except ConfigError:
            raise
        except CompanionError as error:
            first, said = not said or opened.is_set(), "" if opened.is_set() else said
            if str(error) != said:
                said = str(error)
                LOG.error("no vehicle: %s; next attempts every %g s", said, _RETRY_S)  # noqa: TRY400 - for the operator
            telemetry.forget(said)
            dispatcher.waits_for(said)
            if first and isinstance(error, MocapError | ArmError):
                await begun_unless(stop, asyncio.Event(), _log_other_missing(settings, said))
        finally:
            settings.last_resort.flying = bool
        await _sleep(stop, _RETRY_S)


async def _log_other_missing(settings: DaemonSettings, said: str) -> None:
    """Log once which other devices cannot be reached, as devices are opened one after the other."""
    try:
        async with open_live_observer(settings.config, settings.records or Path(), forward_vision=False):
            return
    except DevicesMissingError as missing:
        for check in missing.checks:
            if not check.passed and check.says != said:
                LOG.error("no vehicle: %s", check.says)  # noqa: TRY400 - the sentence is for the operator
    except CompanionError as error:
        LOG.info("%s", error)


async def begun_unless(stop: asyncio.Event, begun: asyncio.Event, doing: Coroutine[Any, Any, None]) -> None:
    """Run a coroutine to its end; cancel it without an error when `stop` is set before `begun`."""
    task = asyncio.create_task(doing, name="companion.vehicle")
    stopping = asyncio.create_task(stop.wait(), name="companion.end")
    try:
        await asyncio.wait({task, stopping}, return_when=asyncio.FIRST_COMPLETED)
        if not begun.is_set():
            task.cancel()
        await asyncio.wait({task})
    finally:
        stopping.cancel()
        task.cancel()
        await asyncio.wait({task})
    if not task.cancelled():
        task.result()


async def _with_vehicle(service: FlightActions, dispatcher: CommandDispatcher, stop: asyncio.Event) -> None:
    """Serve one vehicle until `stop` is set, then land; raise what ends the flight loop earlier."""
    for warning in service.reports.warnings:
        LOG.warning("%s", warning)
    LOG.info("the vehicle is there: run `companion preflight`, then `companion arm`")
    ending = asyncio.create_task(stop.wait(), name="companion.end")
    async with dispatcher.serving(service):
        try:
            await asyncio.wait({ending, service.ticking}, return_when=asyncio.FIRST_COMPLETED)
            if service.ticking.done():
                service.ticking.result()
            await _land(service)
        finally:
            ending.cancel()


def _depends_on_process(service: FlightActions) -> bool:
    """Return whether the vehicle would fall or land blind without this process.

    True while setpoints are sent, and for _LANDING_S after handing over, which is longer than a landing by PX4 takes.
    """
    landing = service.phase is Phase.HANDED_OVER and time.monotonic() - service.loop.flight.since_s < _LANDING_S
    return service.phase in STREAMING or landing


async def _land(service: FlightActions) -> None:
    """Land before the devices are closed; wait when the autopilot or its pilot has the vehicle."""
    if service.phase not in STREAMING | {Phase.HANDED_OVER}:
        return
    LOG.warning("landing, then the service ends")
    try:
        await service.land("the service was told to end")
    except CompanionError as error:
        LOG.error("%s", error)  # noqa: TRY400 - the sentence is for the operator


async def _publish_state(publisher: StatePublisher, heartbeat: LoopHeartbeat, settings: DaemonSettings) -> None:
    """Publish the state ten times a second, and notify systemd while the control loop ticks or is not running."""
    while True:
        if lives(heartbeat.ticked_s, publisher.dispatcher.ticking, time.monotonic()):
            settings.notifier.alive()
        try:
            state = publisher.publish(settings.recorder)
            settings.notifier.status(f"{state.phase}: {state.reason}" if state.reason else state.phase)
        except Exception:
            LOG.exception("the state cannot be published")
        await asyncio.sleep(STATE_S)


def lives(ticked_s: float, ticking: bool, now_s: float) -> bool:
    """Return whether to notify systemd: the control loop has ticked recently, or is not meant to tick.

    A loop that has failed still sends poses to the autopilot, which lands; killed by systemd, it would land blind.
    """
    return not ticking or now_s - ticked_s < _TICK_TIMEOUT_S


async def _sleep(stop: asyncio.Event, for_s: float) -> None:
    try:
        async with asyncio.timeout(for_s):
            await stop.wait()
    except TimeoutError:
        return
