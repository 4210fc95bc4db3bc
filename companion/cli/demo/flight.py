"""One flight of the demo: start the mocks and the service, run the commands in order, land in any case."""

import asyncio
import re
import signal
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from companion import __version__
from companion.adapters.system.watchdog_timer import KernelWatchdogTimer
from companion.analysis.summary import Summary, summarise
from companion.cli.demo.fault_messages import shorter, still_there
from companion.cli.demo.flight_log import FlightStory
from companion.cli.demo.ground_process import Ground, Radio, law_on_ground, newest_record
from companion.cli.demo.mock_process import FaultTold, MockError, MockPorts, mock_process
from companion.cli.demo.progress import FlightDisplay
from companion.cli.demo.stay import Gate, stay
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import ON_GROUND, LoadedController, controller_text
from companion.control.remote_law import RemoteLaw
from companion.core.interfaces import CompanionError, FlightError
from companion.flight.sinks import FanOutSink
from companion.protocol.commands import Track
from companion.records.record_process import RecordSink
from companion.records.recorder import Recorder
from companion.service.flight_actions import FlightActions
from companion.service.local_operator import LocalOperator, open_local_operator
from companion.supervisor.flight_state import Phase

_POLL_S = 0.02
_THEIRS_S = 30.0
"""Time for which a flight under the pilot's or PX4's control is watched."""
_STOPPED_S = 1.0
_GROUND_S = 20.0
_SHOWN_S = 0.1


@dataclass(frozen=True, kw_only=True)
class DemoFlight:
    """Description of one demo flight."""

    config: CompanionConfig
    controller: LoadedController
    trajectory_name: str
    track: Track
    """Command that flies the trajectory and moves the arms."""
    notes: tuple[str, ...]
    """Notes about the arms' motion for the user."""
    mock_config: Path
    ports: MockPorts
    seed: int
    start_mocks: bool
    faults: tuple[str, ...]
    """Faults to inject, as sentences."""
    records: Path
    """Folder of the record."""
    ground: Ground | None = None
    """Law in a process on the ground; None: on board."""
    stay_s: float = 0.0
    """Time for which the vehicle stays on the page after the report, s; infinite: until Ctrl-C."""

    @property
    def name(self) -> str:
        """Trajectory, law and seed as a part of a file's name."""
        name = f"{Path(self.trajectory_name).stem}-{Path(self.controller.name).stem}-seed{self.seed}"
        return re.sub(r"[^A-Za-z0-9_-]", "_", name)


@dataclass(kw_only=True)
class Flown:
    """Result of a demo flight."""

    recorder: Recorder
    """Ticks of the flight, for the summary and the picture."""
    story: FlightStory
    interrupted: bool = False
    failure: str = ""
    """Reason why the flight did not go as planned; empty when it did."""
    begun: list[str] = field(default_factory=list)
    """Injected faults that began."""
    never: list[str] = field(default_factory=list)
    """Requested faults that never began."""
    summary: Summary | None = None
    record: Path | None = None
    """The flight's file; None where there is none."""
    ground_record: Path | None = None
    """File of the law on the ground; None where there is none."""
    record_trouble: str = ""
    """Reason why the record is incomplete; empty when it is complete."""
    reported: bool = False
    """The report was printed before the vehicle stayed on the page."""


async def fly_demo(flight: DemoFlight, console: Console, report: Callable[[Flown], None]) -> Flown:
    """Start the mocks, fly, stop the mocks. Never leaves the vehicle in the air while it can be commanded.

    `report` is called with the result when it is over, and while the vehicle stays on the page, in a thread.
    """
    display = FlightDisplay(console, flight.trajectory_name, flight.controller.name)
    flown = Flown(recorder=Recorder(), story=display.story)
    kept, radio = _kept(flight), Radio()

    def hear(told: FaultTold) -> None:
        kept.tell("injected fault", f"{told.sentence}: {told.turn}", time.monotonic())
        if told.turn == "never began":
            flown.never.append(told.sentence)
            return
        if told.turn == "begins":
            flown.begun.append(told.sentence)
            radio.begin(told.sentence)
        display.say_fault(told)

    try:
        async with _mocks(flight, hear):
            for note in flight.notes:
                console.print(Text(f"  arms: {note}", style="dim"), soft_wrap=True)
            for sentence in flight.faults:
                console.print(Text.assemble("  ", ("fault", "bold"), f" {sentence}"), soft_wrap=True)
            with display:
                try:
                    display.say("connecting to motion capture and autopilot")
                    gate = Gate(FanOutSink([flown.recorder, kept, display.take]))
                    watchdog_timer = KernelWatchdogTimer(flight.config.safety.dead_man_s)
                    async with (
                        _law_placed(flight, radio) as (config, law),
                        open_local_operator(config, law, gate, watchdog_timer, flight.records, display.say) as operator,
                    ):
                        kept.begin({"config": config.model_dump(mode="json")})
                        operator.recorder = kept
                        await _mission(flight, operator, display, flown)
                        if flight.stay_s > 0.0 and not flown.interrupted:
                            gate.sink = None
                            display.close()
                            await stay(
                                operator.service, flight.stay_s, partial(_report, flight, flown, gate, kept, report)
                            )
                except CompanionError as error:
                    if not flown.recorder.flew:
                        raise
                    flown.failure = flown.failure or str(error)
    finally:
        if flown.reported:
            await asyncio.to_thread(kept.close)
        else:
            await _close(kept, flown)
    if not flown.reported:
        _conclude(flight, flown)
        report(flown)
    return flown


def _conclude(flight: DemoFlight, flown: Flown) -> None:
    """Note the record of the law on the ground, and the numbers."""
    if flight.ground is not None and flown.recorder.flew:
        flown.ground_record = newest_record(flight.records, flight.name)
    flown.summary = summarise(flown.recorder.arrays()) if flown.recorder.flew else None


async def _report(
    flight: DemoFlight, flown: Flown, gate: Gate, kept: RecordSink, report: Callable[[Flown], None]
) -> None:
    """Complete the record and report the flight; record what is flown from the page afterwards."""
    await _close(kept, flown)
    _conclude(flight, flown)
    flown.reported = True
    await asyncio.to_thread(report, flown)
    gate.sink = kept


def _kept(flight: DemoFlight) -> RecordSink:
    """Return the sink of the record, named after trajectory, law and seed."""
    records = flight.config.records.model_copy(update={"folder": str(flight.records)})
    if flight.ports.client is not None:  # so that demos run beside each other
        records = records.model_copy(update={"live_port": 0})
    kept = RecordSink(records, flight.name)
    controller = {"name": flight.controller.name, "file": controller_text(flight.controller.name)}
    kept.begin(
        {
            "vehicle": _vehicle(flight),
            "config": flight.config.model_dump(mode="json"),
            "controller": controller,
            "versions": {"companion": __version__},
            "seed": flight.seed,
            "trajectory": flight.trajectory_name,
            "arms": flight.track.arms or "off",
            "faults": flight.faults,
        }
    )
    return kept


def _vehicle(flight: DemoFlight) -> str:
    """Return the configured name of the vehicle, else `mock`."""
    return flight.config.operator.vehicle if flight.config.operator else "mock"


async def _close(kept: RecordSink, flown: Flown) -> None:
    """Complete the record; delete that of a vehicle that never flew."""
    await asyncio.to_thread(kept.close)
    path = Path(kept.file) if kept.file else None
    if path is not None and not flown.recorder.flew:
        path.unlink(missing_ok=True)
        return
    flown.record, flown.record_trouble = path, kept.failed or ""


@asynccontextmanager
async def _mocks(flight: DemoFlight, hear: Any) -> AsyncIterator[None]:
    if not flight.start_mocks:
        yield
        return
    try:
        async with mock_process(flight.mock_config, flight.seed, flight.ports, flight.faults, hear):
            yield
    except MockError as error:
        if "in use" in str(error):
            raise MockError(f"{error}; or fly with --free-ports, or with --no-mocks if mocks are running") from error
        raise


@asynccontextmanager
async def _law_placed(flight: DemoFlight, radio: Radio) -> AsyncIterator[tuple[CompanionConfig, LoadedController]]:
    """Run the law where it is to run; yield the vehicle's configuration and law."""
    if flight.ground is None:
        yield flight.config, flight.controller
        return
    place = replace(flight.ground, record=flight.name, folder=flight.records)
    async with law_on_ground(flight.config, flight.controller, place, flight.seed, radio) as config:
        yield config, LoadedController(ON_GROUND, RemoteLaw(), flight.controller.error_limits)


async def _ground_law_connected(operator: LocalOperator, display: FlightDisplay) -> None:
    """Wait for a law on the ground; FlightError when none comes."""
    remote = operator.service.loop.remote
    if remote is None:
        return
    display.say("waiting for the law on the ground")
    if not await operator.service.until(lambda: remote.status.connected, _GROUND_S):
        raise FlightError(f"no ground law has connected within {_GROUND_S:g} s: {remote.status.refused or 'silence'}")


async def _mission(flight: DemoFlight, operator: LocalOperator, display: FlightDisplay, flown: Flown) -> None:
    """Fly; land after every error and interrupt."""
    service = operator.service
    work = asyncio.create_task(_fly(flight, operator, display), name="companion.demo")

    def on_interrupt() -> None:
        landing = flown.interrupted or service.phase in {Phase.STOW, Phase.LAND}
        display.say("interrupted: already landing" if landing else "interrupted: landing")
        if not flown.interrupted:
            work.cancel()
        flown.interrupted = True

    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, on_interrupt)
    said = ""
    try:
        await work
    except asyncio.CancelledError:
        if not flown.interrupted:
            raise
    except CompanionError as error:
        said = shorter(str(error))
        if service.loop.flight.airborne and not display.story.ending():
            display.say(f"{said}; it lands")
    still = await _land_anyway(service, display.story, flown)
    flown.failure = display.story.ending(still) or said or shorter(service.trouble)


async def _fly(flight: DemoFlight, operator: LocalOperator, display: FlightDisplay) -> None:
    """Send the commands; another operator's hold ends them, and lasts until an operator or a fault ends it."""
    for warning in operator.service.reports.warnings:
        display.say(warning)
    commands = asyncio.create_task(_commands(flight, operator, display), name="companion.demo_commands")
    try:
        while not (commands.done() or display.story.held):
            await asyncio.wait({commands}, timeout=_POLL_S)
        if not display.story.held:  # the end of a command may be known before the tick that shows why
            await asyncio.sleep(_SHOWN_S)
        while display.story.held and operator.service.phase is Phase.HOLD:  # noqa: ASYNC110 - the phase has no event
            await asyncio.sleep(_POLL_S)
    finally:
        commands.cancel()
        await asyncio.gather(commands, return_exceptions=True)
    if not display.story.held:
        commands.result()


async def _commands(flight: DemoFlight, operator: LocalOperator, display: FlightDisplay) -> None:
    await _ground_law_connected(operator, display)
    await operator.do("arm")
    await operator.do("takeoff")
    await operator.send(flight.track)


async def _land_anyway(service: FlightActions, story: FlightStory, flown: Flown) -> str:
    """Land, or wait for a pilot or PX4 to land; return what is still going on, empty when the flight is over."""
    landing = asyncio.create_task(_down(service, story, flown), name="companion.demo_landing")
    try:
        await asyncio.shield(landing)
    except CompanionError as error:
        return still_there(story.last, str(error)) if story.last is not None else str(error)
    return ""


async def _down(service: FlightActions, story: FlightStory, flown: Flown) -> None:
    """Land; wait while a pilot or PX4 has the vehicle, as the operator may resume, but not after Ctrl-C."""
    loop, hovering = asyncio.get_running_loop(), frozenset({Phase.RESUME})
    end_s = loop.time() + _THEIRS_S
    while service.phase in hovering | {Phase.HANDED_OVER} and not flown.interrupted and _goes_on(story):
        if service.phase is Phase.RESUME:
            hovering |= {Phase.HOLD}
        if service.phase is not Phase.HANDED_OVER:
            end_s = loop.time() + _THEIRS_S
        if story.last is not None and not story.last.status.connected:
            raise FlightError("the autopilot has gone silent: look at the vehicle")
        if loop.time() > end_s:
            raise FlightError("the autopilot is still armed")
        await asyncio.sleep(_POLL_S)
    story.ours = service.phase not in {Phase.STOW, Phase.LAND}  # else it was commanded before
    await service.land()


def _goes_on(story: FlightStory) -> bool:
    """Return whether the flight loop still ticks."""
    return story.last is not None and time.monotonic() - story.last.time_s < _STOPPED_S
