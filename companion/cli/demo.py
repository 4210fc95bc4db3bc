"""`companion demo`: a whole flight against the mocks, over the real protocols, in real time."""

import asyncio
import json
import logging
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
import uvloop
from rich.console import Console
from rich.markup import escape

from companion.adapters.dead_man import KernelDeadMan
from companion.adapters.recorder import Recorder
from companion.cli.asked import FAILED, INTERRUPTED
from companion.cli.demo_arms import plan_arms
from companion.cli.flight_report import print_comparison, print_report, summary_dict, within_limits
from companion.cli.mock_process import MockError, MockPorts, free_ports, mock_process
from companion.cli.options import AllowUnstable, ArmsFeedforward, ControllerName, SummaryFile
from companion.cli.output import check_output
from companion.cli.progress import FlightDisplay
from companion.config import CompanionConfig, default_config_path, load_config
from companion.config_arms import Feedforward
from companion.config_controller import LoadedController, load_controller
from companion.control.reference import Trajectory
from companion.experiments.summary import Summary, summarise
from companion.ports import CompanionError
from companion.service import Service, open_service
from companion.supervisor.flight import Phase
from companion.trajectory_check import check_trajectory
from companion.trajectory_files import Curve, trajectory_named


@dataclass(frozen=True)
class DemoFlight:
    """One flight to be flown."""

    config: CompanionConfig
    controller: LoadedController
    trajectory_name: str
    trajectory: Trajectory
    arms: str
    """What they do meanwhile, as in --arms."""
    mock_config: Path
    ports: MockPorts
    seed: int
    start_mocks: bool
    faults: tuple[str, ...]
    """What the mocks let go wrong, in their words."""
    records: Path
    """Where the record goes."""


@dataclass(frozen=True)
class Flown:
    """What came of it."""

    recorder: Recorder
    summary: Summary | None
    interrupted: bool
    failure: str


def demo(
    trajectory: Annotated[str, typer.Option(help="ellipse, figure8, or a CSV file of waypoints.")] = "ellipse",
    controller: ControllerName = None,
    allow_unstable: AllowUnstable = False,
    arms: Annotated[
        str, typer.Option(help="swing, off, another name in config/arms/, or a file of joint motion.")
    ] = "swing",
    feedforward: ArmsFeedforward = None,
    laps: Annotated[int, typer.Option(min=1, max=100, help="Laps of ellipse or figure8.")] = 2,
    period: Annotated[float, typer.Option(min=4.0, max=120.0, help="Seconds a lap, at full speed.")] = 15.0,
    size: Annotated[float, typer.Option(min=0.1, max=3.0, help="Size of the curve; 1 is 2 m across.")] = 1.0,
    compare: Annotated[str | None, typer.Option(help="Fly this controller, too, and show both.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the mocks' noise and disturbances.")] = 1,
    config: Annotated[Path | None, typer.Option(help="Companion configuration; config/demo.toml if not given.")] = None,
    mock_config: Annotated[Path | None, typer.Option(help="Mock configuration; config/mock.toml if not given.")] = None,
    summary: SummaryFile = None,
    out: Annotated[Path, typer.Option(help="Folder for the plot and the record.")] = Path("flights"),
    mocks: Annotated[
        bool, typer.Option(help="Start the mocks; --no-mocks flies against what is already running.")
    ] = True,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SENTENCE",
            help="Let something go wrong; may be given again: 'mocap stuck at 12 s for 2 s', 'link delayed by 0.2 s at "
            "10 s', 'autopilot wrong (pilot takes over) in the air after 8 s'. Times count from lift-off. All there "
            "is: docs/faults.md.",
        ),
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show everything the parts say.")] = False,
    free: Annotated[bool, typer.Option("--free-ports", help="Any free ports instead of PX4's and QTM's.")] = False,
) -> None:
    """Fly takeoff, hold, laps of a trajectory and landing against the mocks, and say how good it was.

    Exit code 0 only if it landed, disarmed and stayed inside the controller's error limits; 1 if not, 2 for what could
    not be started, 130 after Ctrl-C, which lands.
    """
    logging.basicConfig(level=logging.CRITICAL, format="%(levelname)s %(name)s: %(message)s")
    if verbose:
        logging.getLogger("companion").setLevel(logging.DEBUG)
    if fault and not mocks:
        raise MockError("--fault is for the mocks that the demo starts: give it to the running ones, or no --no-mocks")
    console = Console()
    settings = _with_feedforward(load_config(config or default_config_path("demo.toml")), feedforward)
    curve = Curve(laps, period, size, settings.flight.takeoff_height_m)
    ports = free_ports() if free else MockPorts()
    flights = [
        DemoFlight(
            _on_ports(settings, ports),
            load_controller(name, settings.vehicle_model(), 1.0 / settings.control.rate_hz, allow_unstable),
            trajectory,
            trajectory_named(trajectory, curve),
            arms,
            mock_config or default_config_path("mock.toml"),
            ports,
            seed,
            mocks,
            tuple(fault or ()),
            out,
        )
        for name in (controller or settings.control.controller, *([compare] if compare else []))
    ]
    for flight in flights:
        check_trajectory(flight.trajectory, settings.room, trajectory)
        for note in _check_arms(flight):
            console.print(f"  [dim]arms: {note}[/]", highlight=False)
    check_output(out, summary)
    results = []
    for flight in flights:
        try:
            flown = uvloop.run(fly_demo(flight, console))
        except KeyboardInterrupt:
            console.print("[yellow]interrupted[/] before the flight")
            raise typer.Exit(INTERRUPTED) from None
        results.append(_conclude(flight, flown, console, out))
        if flown.interrupted:
            break
    if len(results) > 1:
        print_comparison(
            console,
            [(flight.controller.name, result.summary) for flight, result in zip(flights, results, strict=False)],
        )
    if summary is not None:
        first, *others = [result.as_dict for result in results]
        text = json.dumps(first | ({"compared": others} if others else {}), indent=2)
        summary.write_text(text + "\n", encoding="utf-8")
    raise typer.Exit(max(result.code for result in results))


def _with_feedforward(config: CompanionConfig, wanted: Feedforward | None) -> CompanionConfig:
    if wanted is None or config.arms is None:
        return config
    return config.model_copy(update={"arms": config.arms.model_copy(update={"feedforward": wanted})})


def _on_ports(config: CompanionConfig, ports: MockPorts) -> CompanionConfig:
    """The configuration, with the ports that were chosen for it."""
    if ports.client is None or ports.qualisys is None:
        return config
    px4 = config.px4.model_copy(update={"url": f"udpin://127.0.0.1:{ports.client}"})
    mocap = config.mocap.model_copy(update={"port": ports.qualisys})
    arms = config.arms.model_copy(update={"port": ports.servo_link}) if config.arms else None
    return config.model_copy(update={"px4": px4, "mocap": mocap, "arms": arms})


def _check_arms(flight: DemoFlight) -> tuple[str, ...]:
    """What cannot be run is refused before anything starts; what the user should know of the rest."""
    planned = plan_arms(flight.arms, flight.config, flight.trajectory)
    return planned.notes if planned is not None else ()


async def fly_demo(flight: DemoFlight, console: Console) -> Flown:
    """Start the mocks, fly, stop the mocks. Never leaves the vehicle in the air while it can be commanded."""
    recorder = Recorder()
    display = FlightDisplay(console, flight.trajectory_name, flight.controller.name)
    failure, interrupted = "", False
    async with _mocks(flight):
        for sentence in flight.faults:
            console.print(f"  [bold]fault[/] {escape(sentence)}", highlight=False)
        with display:
            try:
                async with _service(flight, recorder, display) as service:
                    interrupted, failure = await _mission(flight, service, display)
            except CompanionError as error:
                if not recorder.flew:
                    raise
                failure = failure or str(error)
    return Flown(recorder, summarise(recorder.arrays()) if recorder.flew else None, interrupted, failure)


@asynccontextmanager
async def _mocks(flight: DemoFlight) -> AsyncIterator[None]:
    if not flight.start_mocks:
        yield
        return
    try:
        async with mock_process(flight.mock_config, flight.seed, flight.ports, flight.faults):
            yield
    except MockError as error:
        if "in use" in str(error):
            raise MockError(f"{error}; or fly with --free-ports, or with --no-mocks if mocks are running") from error
        raise


@asynccontextmanager
async def _service(flight: DemoFlight, recorder: Recorder, display: FlightDisplay) -> AsyncIterator[Service]:
    def sink(tick: Any) -> None:
        recorder(tick)
        display.take(tick)

    display.say("connecting to motion capture and autopilot")
    dead_man = KernelDeadMan(flight.config.safety.dead_man_s)
    async with open_service(flight.config, flight.controller.law, sink, dead_man, flight.records) as service:
        yield service


async def _mission(flight: DemoFlight, service: Service, display: FlightDisplay) -> tuple[bool, str]:
    """The flight itself; whatever goes wrong or is interrupted, it lands. Returns interrupted, failure."""
    work = asyncio.create_task(_fly(flight, service, display), name="companion.demo")
    interrupted = False

    def on_interrupt() -> None:
        nonlocal interrupted
        landing = interrupted or service.phase in {Phase.STOW, Phase.LAND}
        display.say("interrupted: already landing" if landing else "interrupted: landing")
        if not interrupted:
            work.cancel()
        interrupted = True

    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, on_interrupt)
    failure = ""
    try:
        await work
    except asyncio.CancelledError:
        if not interrupted:
            raise
    except CompanionError as error:
        failure = str(error)
        display.say(f"{failure}; waiting until the vehicle is down")
    failure = await _land_anyway(service, failure)
    return interrupted, failure or service.trouble


async def _fly(flight: DemoFlight, service: Service, display: FlightDisplay) -> None:
    await service.ready()
    motion = None
    if flight.config.arms is not None:
        for warning in service.warnings:
            display.say(warning)
        display.say("torque on, arms stowed")
        held_rad = await service.arms.prepare()
        motion = plan_arms(flight.arms, flight.config, flight.trajectory, held_rad)
    display.say("preflight checks, offboard mode, then arming")
    await service.arm(flight.trajectory)
    await service.take_off(flight.config.flight.takeoff_height_m)
    if motion is not None:
        await service.arms.move(motion.trajectory)
    await service.fly(flight.trajectory)


async def _land_anyway(service: Service, failure: str) -> str:
    landing = asyncio.create_task(service.land(), name="companion.demo_landing")
    try:
        await asyncio.shield(landing)
    except CompanionError as error:
        return failure or str(error)
    return failure


@dataclass(frozen=True)
class Result:
    """One flight's end, for the exit code, the comparison and the summary file."""

    code: int
    summary: Summary | None
    as_dict: dict[str, Any]


def _conclude(flight: DemoFlight, flown: Flown, console: Console, out: Path) -> Result:
    """Report, picture and record of one flight."""
    good = within_limits(flown.summary, flight.controller.error_limits) and not flown.failure
    print_report(console, flight.controller, flown.summary, flown.failure, flown.interrupted)
    if flight.start_mocks and "silent" in flown.failure:
        console.print("  The mocks run on this computer: was it too busy to serve them?", highlight=False)
    if flown.recorder.flew:
        _keep(flight, flown, console, out)
    data = summary_dict(flight.trajectory_name, flight.controller.name, flown.summary) | {"failure": flown.failure}
    return Result(INTERRUPTED if flown.interrupted else 0 if good else FAILED, flown.summary, data)


def _keep(flight: DemoFlight, flown: Flown, console: Console, out: Path) -> None:
    """The picture and the record."""
    from companion.experiments.plots import plot_flight  # noqa: PLC0415 - matplotlib takes a second to import

    when = datetime.now(tz=UTC).astimezone().strftime("%Y%m%d-%H%M%S")
    name = f"{when}-{Path(flight.trajectory_name).stem}-{Path(flight.controller.name).stem}-seed{flight.seed}"
    title = f"{Path(flight.trajectory_name).name}, controller {flight.controller.name}, seed {flight.seed}"
    plot_flight(flown.recorder.arrays(), flown.summary, title, out / f"{name}.png")
    flown.recorder.write(out / f"{name}.npz")
    console.print(f"plot [bold]{out / name}.png[/], record {out / name}.npz", soft_wrap=True)
