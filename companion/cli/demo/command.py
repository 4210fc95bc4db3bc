"""`companion demo`: a whole flight against the mocks, over the real protocols, in real time."""

import json
import logging
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
import uvloop
from rich.console import Console

from companion.analysis.summary import Summary
from companion.cli.complete import controllers, motions_or_off, trajectories
from companion.cli.demo.fleet.options import FleetOptions
from companion.cli.demo.flight import DemoFlight, Flown, fly_demo
from companion.cli.demo.flight_report import print_comparison, print_report, summary_dict, within_limits
from companion.cli.demo.ground_process import Ground, of_network
from companion.cli.demo.mock_process import MockError, MockPorts, free_ports
from companion.cli.demo.page import page_of_demo, stays_s, with_broker
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.cli.options import (
    AllowUnstable,
    ArmsFeedforward,
    ControllerName,
    LawOn,
    Place,
    RadioLink,
    SummaryFile,
    check_link,
    settings_of,
)
from companion.cli.output import as_typed, check_output, kept
from companion.config.arms_config import ArmsConfig, Feedforward
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.config.locations import default_config_path
from companion.config.trajectory_files import Curve, rows_of, trajectory_named
from companion.core.interfaces import ConfigError
from companion.flight.assembly import controller_of, margin_in
from companion.protocol.commands import Track
from companion.service.local_operator import local_command
from companion.service.planning import APPROACH_S, plan_motion
from companion.service.trajectory_space import require_inside
from companion.supervisor.faults import Fault
from companion.trajectories.reference import Trajectory
from companion.trajectories.waypoints import Waypoints

_BUSY = frozenset({
    Fault.MOCAP_LATE, Fault.MOCAP_DEGRADED, Fault.MOCAP_SILENT, Fault.MOCAP_SLOW, Fault.MOCAP_DELAYED,
    Fault.AUTOPILOT_SILENT, Fault.LOOP_LATE, Fault.ARMS,
})  # fmt: skip
"""Faults that suggest a too busy computer when none was injected."""
_BUSY_WORDS = ("silent", "mocap rate", "mocap age", "has not answered", "have not answered")


def demo(
    trajectory: Annotated[
        str, typer.Option(help="ellipse, figure8, or a CSV file of waypoints.", autocompletion=trajectories)
    ] = "ellipse",
    controller: ControllerName = None,
    allow_unstable: AllowUnstable = False,
    arms: Annotated[
        str,
        typer.Option(
            help="swing, off, another name in config/arms/, or a file of joint motion.", autocompletion=motions_or_off
        ),
    ] = "swing",
    feedforward: ArmsFeedforward = None,
    laps: Annotated[int, typer.Option(min=1, max=100, help="Laps of ellipse or figure8.")] = 2,
    period: Annotated[float, typer.Option(min=4.0, max=120.0, help="Time for one lap at full speed, s.")] = 15.0,
    size: Annotated[float, typer.Option(min=0.1, max=3.0, help="Scale ellipse or figure8: 1 is 2 m long.")] = 1.0,
    compare: Annotated[
        str | None, typer.Option(help="Fly this controller afterwards and show both.", autocompletion=controllers)
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the mocks' noise and disturbances.")] = 1,
    config: Annotated[Path | None, typer.Option(help="Companion configuration.  [default: config/demo.toml]")] = None,
    mock_config: Annotated[Path | None, typer.Option(help="Mock configuration.  [default: config/mock.toml]")] = None,
    summary: SummaryFile = None,
    out: Annotated[Path, typer.Option(help="Write the plot and the record into this folder.")] = Path("flights"),
    mocks: Annotated[bool, typer.Option(help="Start the mocks; --no-mocks connects to mocks that already run.")] = True,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SENTENCE",
            help="Inject a fault; may be repeated: 'mocap stuck at 12 s for 2 s', 'link delayed by 0.2 s at 10 s', "
            "'autopilot wrong (pilot takes over) in the air after 8 s'. Times count from lift-off. All faults: "
            "docs/faults.md.",
        ),
    ] = None,
    law_on: LawOn = Place.BOARD,
    onboard_mocap: Annotated[
        bool, typer.Option(help="With --law-on ground: frames of motion capture reach the vehicle, too.")
    ] = True,
    link: RadioLink = None,
    page: Annotated[
        bool, typer.Option("--page", help="Serve the live page: its address is printed, and opened on a desktop.")
    ] = False,
    stay: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            metavar="S",
            help="With --page: stay on the page for so long after the report, to fly on from it.  [default: until "
            "Ctrl-C on a terminal, else 0]",
        ),
    ] = None,
    vehicles: Annotated[
        int, typer.Option(min=1, max=3, help="Fly this many vehicles at the same time: laps, then crossing ways.")
    ] = 1,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print all log messages.")] = False,
    free: Annotated[bool, typer.Option("--free-ports", help="Use free ports, to run several demos at once.")] = False,
) -> None:
    """Fly takeoff, hold, laps of a trajectory and landing against the mocks, and print the errors.

    Exit codes: 0 landed, disarmed and inside the controller's error limits; 1 not so; 2 could not be started; 130
    after Ctrl-C, which lands.
    """
    logging.basicConfig(level=logging.CRITICAL, format="%(levelname)s %(name)s: %(message)s")
    if verbose:
        logging.getLogger("companion").setLevel(logging.DEBUG)
    console = Console()
    settings = _with_feedforward(settings_of(config, "demo.toml"), feedforward)
    _check_faults(fault or (), mocks, broker=settings.operator is not None)
    if law_on is Place.BOARD:
        _check_no_network(fault or ())
    elif link is None and any(map(of_network, fault or ())):
        link = "clean"  # the faults need a relay
    if not onboard_mocap and law_on is Place.BOARD:
        raise ConfigError("--no-onboard-mocap: a law on board needs frames: give --law-on ground")
    check_link(law_on, link)
    if vehicles > 1:
        raise typer.Exit(
            _several(
                FleetOptions(
                    vehicles=vehicles,
                    settings=settings,
                    law=_law(controller or settings.control.controller, settings, allow_unstable),
                    arms=arms if settings.arms is not None and arms != "off" else None,
                    laps=laps,
                    seed=seed,
                    mock_config=mock_config or default_config_path("mock.toml"),
                    faults=tuple(fault or ()),
                    free_ports=free,
                    out=out,
                    summary=summary,
                    page=page,
                    stay_s=stays_s(page, stay),
                ),
                console,
                compare or link or not mocks or law_on is not Place.BOARD or trajectory != "ellipse",
            )
        )
    curve = Curve(laps, period, size, settings.flight.takeoff_height_m)
    ports = free_ports() if free else MockPorts()
    flown = trajectory_named(trajectory, curve)
    after_s = stays_s(page, stay)
    if page:
        settings = with_broker(settings, free)
    require_inside(flown, settings.room, settings.fence, trajectory)
    notes = _check_arms(arms, settings.arms, flown)
    flights = [
        DemoFlight(
            config=_on_ports(settings, ports),
            controller=_law(name, settings, allow_unstable),
            trajectory_name=trajectory,
            track=_track(trajectory, curve, flown, arms if settings.arms is not None and arms != "off" else None),
            notes=notes,
            mock_config=mock_config or default_config_path("mock.toml"),
            ports=ports,
            seed=seed,
            start_mocks=mocks,
            faults=tuple(fault or ()),
            records=out,
            ground=Ground(onboard_mocap, link) if law_on is Place.GROUND else None,
        )
        for name in (controller or settings.control.controller, *([compare] if compare else []))
    ]
    flights[-1] = replace(flights[-1], stay_s=after_s)
    check_output(out, summary)
    with page_of_demo(settings, free, console) if page else nullcontext():
        results = _fly(flights, console, out)
    if len(results) > 1:
        print_comparison(
            console,
            [(flight.controller.name, result.summary) for flight, result in zip(flights, results, strict=False)],
        )
    _say_next([result.record for result in results if result.record is not None], console)
    if summary is not None:
        first, *others = [result.as_dict for result in results]
        text = json.dumps(first | ({"compared": others} if others else {}), indent=2)
        summary.write_text(text + "\n", encoding="utf-8")
    raise typer.Exit(max(result.code for result in results))


def _fly(flights: Sequence[DemoFlight], console: Console, out: Path) -> list["Result"]:
    """Fly one after the other, up to an interrupt; print the report of each."""
    results: list[Result] = []
    for flight in flights:

        def report(flown: Flown, flight: DemoFlight = flight) -> None:
            results.append(_conclude(flight, flown, console, out))
            if flown.reported:
                console.print("the vehicle stays on the page: fly on from there; Ctrl-C lands and ends", soft_wrap=True)

        try:
            outcome = uvloop.run(fly_demo(flight, console, report))
        except KeyboardInterrupt:
            console.print("[yellow]interrupted[/] before the flight")
            raise typer.Exit(INTERRUPTED) from None
        if outcome.interrupted:
            break
    return results


def _several(options: FleetOptions, console: Console, of_one: object) -> int:
    """Fly several vehicles; `of_one`: an option was given that is for one vehicle."""
    if of_one:
        raise ConfigError(
            f"--vehicles {options.vehicles}: flies laps and crossing ways, laws on board: leave out --trajectory, "
            "--compare, --law-on, --link and --no-mocks"
        )
    check_output(options.out, options.summary)
    from companion.cli.demo.fleet.command import fly  # noqa: PLC0415 - one vehicle starts without the client

    return fly(options, console)


def _with_feedforward(config: CompanionConfig, wanted: Feedforward | None) -> CompanionConfig:
    if wanted is None or config.arms is None:
        return config
    return config.model_copy(update={"arms": config.arms.model_copy(update={"feedforward": wanted})})


def _on_ports(config: CompanionConfig, ports: MockPorts) -> CompanionConfig:
    """Return the configuration with the chosen ports in it."""
    if ports.client is None or ports.qualisys is None:
        return config
    px4 = config.px4.model_copy(update={"url": f"udpin://127.0.0.1:{ports.client}"})
    mocap = config.mocap.model_copy(update={"port": ports.qualisys})
    arms = config.arms.model_copy(update={"port": ports.servo_link}) if config.arms else None
    return config.model_copy(update={"px4": px4, "mocap": mocap, "arms": arms})


def _law(name: str, settings: CompanionConfig, allow_unstable: bool) -> LoadedController:
    """Load a law that has enough margin on this vehicle; ConfigError otherwise."""
    law = controller_of(settings, name, allow_unstable)
    margin_in(settings, law)
    return law


def _check_no_network(faults: Sequence[str]) -> None:
    """Raise MockError for a fault of the network: with the law on board nothing uses one."""
    for sentence in filter(of_network, faults):
        raise MockError(f'--fault "{sentence}": with the law on board there is no such network: give --law-on ground')


def _check_faults(faults: Sequence[str], mocks: bool, broker: bool) -> None:
    """Raise MockError for faults that this demo cannot inject; the mocks check the sentences when they start."""
    if faults and not mocks:
        raise MockError("--fault is for the mocks that the demo starts: give it to the running ones, or no --no-mocks")
    for sentence in faults:
        if sentence.lower().split()[:1] == ["broker"] and not broker:
            raise MockError(
                f'--fault "{sentence}": no broker is listened to: the configuration has no [operator], see docs/bus.md'
            )


def _check_arms(name: str, config: ArmsConfig | None, trajectory: Trajectory) -> tuple[str, ...]:
    """Plan the arms' motion before anything starts; return the plan's notes. Raises ConfigError or ArmError."""
    if config is None and name not in {"off", "swing"}:
        raise ConfigError(f"--arms {name}: this vehicle has no arms, its configuration has no [arms]")
    if config is None or name == "off":
        return ()
    return plan_motion(name, trajectory.duration_s + APPROACH_S, config, config.stow_rad()).notes


def _track(name: str, curve: Curve, trajectory: Trajectory, arms: str | None) -> Track:
    """Return the command that flies the trajectory and moves the arms."""
    if isinstance(trajectory, Waypoints):
        command = local_command("track", waypoints=rows_of(trajectory))
    else:
        command = local_command("track", curve=name, **asdict(curve))
    assert isinstance(command, Track)
    return command.model_copy(update={"arms": arms})  # unchecked: on the bus it may not be a file


@dataclass(frozen=True)
class Result:
    """One flight's end, for the exit code, the comparison and the summary file."""

    code: int
    record: Path | None
    """None when none was written."""
    summary: Summary | None
    as_dict: dict[str, Any]


def _conclude(flight: DemoFlight, flown: Flown, console: Console, out: Path) -> Result:
    """Print the report of one flight, keep its picture and record; return the result."""
    good = within_limits(flown.summary, flight.controller.error_limits) and not flown.failure
    print_report(console, flight.controller, flown.summary, flown.failure, flown.interrupted)
    if flight.start_mocks and _looks_busy(flown):
        console.print("  The mocks run on this computer: it may have been too busy to serve them.", highlight=False)
    for sentence in flown.never:
        over = flown.story.over_at()
        when = f": the flight was over at {over}" if over else ": it did not come to a flight"
        console.print(f"  fault {sentence} never began{when}", markup=False, highlight=False, soft_wrap=True)
    lost = _keep(flight, flown, console, out) if flown.recorder.flew else ""
    data = summary_dict(flight.trajectory_name, flight.controller.name, flown.summary) | {"failure": flown.failure}
    code = 0 if good and not lost else FAILED
    return Result(INTERRUPTED if flown.interrupted else code, flown.record, flown.summary, data)


def _say_next(records: Sequence[Path], console: Console) -> None:
    """Print the next command to try with the records; several flights go onto one page."""
    if records:
        flights = " ".join(map(str, records))
        console.print(f"next: {as_typed()} report {flights}", markup=False, highlight=False, soft_wrap=True)
        console.print("      or open the record in Foxglove: docs/records.md", markup=False, highlight=False)


def _looks_busy(flown: Flown) -> bool:
    """Return whether a flight without injected faults ended by one that a too slow computer causes."""
    if flown.begun or not flown.failure:
        return False
    ended = any(one.cause in _BUSY for one in flown.story.reactions)
    return ended or any(word in flown.failure for word in _BUSY_WORDS)


def _keep(flight: DemoFlight, flown: Flown, console: Console, out: Path) -> str:
    """Write the picture, name picture and record; return why one is missing, or an empty string."""
    from companion.analysis.plots import plot_flight  # noqa: PLC0415 - matplotlib takes a second to import

    when = f"{datetime.now(tz=UTC).astimezone():%Y%m%d-%H%M%S}"
    record = flown.record or out / f"{when}-{flight.name}.mcap"
    title = f"{Path(flight.trajectory_name).name}, controller {flight.controller.name}, seed {flight.seed}"
    plot = record.with_suffix(".png")
    lost = [
        kept(plot, lambda path: plot_flight(flown.recorder.arrays(), flown.summary, title, path)),
        flown.record_trouble or ("" if flown.record else f"{record} was not written"),
    ]
    for sentence in filter(None, lost):
        typer.echo(f"companion: {sentence}", err=True)
    words = [
        f"{what} {path}" for what, path, bad in zip(("plot", "record"), (plot, record), lost, strict=True) if not bad
    ]
    if flown.ground_record is not None:
        words.append(f"the ground's record {flown.ground_record}")
    console.print(", ".join(words), markup=False, highlight=False, soft_wrap=True)
    return "; ".join(filter(None, lost))
