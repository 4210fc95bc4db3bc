"""`companion simulate`: one experiment, or the demo, in virtual time."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from companion.cli.complete import experiments, motions_or_off, trajectories
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED, seeds_of
from companion.cli.options import (
    AllowUnstable,
    ArmsFeedforward,
    ControllerName,
    LawOn,
    Place,
    RadioLink,
    SummaryFile,
    check_link,
)
from companion.cli.output import check_output
from companion.cli.studies.simulate_report import Flights, flights_of, keep_flights, print_flights, summary_of
from companion.cli.terminal import progress_bar
from companion.config.arms_config import Feedforward
from companion.config.companion_config import load_config
from companion.config.controller_config import LoadedController, load_controller
from companion.config.law_margin import require_margin
from companion.config.locations import default_config_path
from companion.config.trajectory_files import Curve, trajectory_named
from companion.control.law_check import in_flight
from companion.core.interfaces import ConfigError
from companion.simulation.demo_scene import demo_scene, load_mock
from companion.simulation.mission import stacked
from companion.simulation.scene import HorizonError, Scene, load_scene
from companion.simulation.simulation import simulate as fly
from companion.simulation.virtual_link import radio_named
from companion.studies.paper.ablations import Ablation, load_ablated
from companion.trajectories.room_check import check_trajectory

_DEMO_ONLY = ("trajectory", "laps", "period", "size", "arms", "config", "mock_config")
_SHOWN_CYCLES = 50
"""Cycles between updates of the progress bar."""


def simulate(
    context: typer.Context,
    experiment: Annotated[
        str,
        typer.Argument(
            help="ellipse, figure8, another name in config/experiments/, or a TOML file.", autocompletion=experiments
        ),
    ] = "ellipse",
    controller: ControllerName = None,
    allow_unstable: AllowUnstable = False,
    law_on: LawOn = Place.BOARD,
    link: RadioLink = None,
    ablate: Annotated[Ablation | None, typer.Option(help="Fly the ET-NN law without this part.")] = None,
    feedforward: ArmsFeedforward = None,
    bandwidth: Annotated[
        float | None, typer.Option(min=2.0, max=40.0, help="Bandwidth of roll and pitch, rad/s; the law knows it.")
    ] = None,
    horizon: Annotated[
        HorizonError | None,
        typer.Option(help="Replace the configured error of the autopilot's horizon; px4-...: as recorded."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of noise and disturbance.")] = 1,
    seeds: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST", help="Fly each of these seeds, all at once.")
    ] = None,
    demo: Annotated[bool, typer.Option("--demo", help="Fly `companion demo` instead of an experiment.")] = False,
    trajectory: Annotated[
        str,
        typer.Option(help="With --demo: ellipse, figure8, or a CSV file of waypoints.", autocompletion=trajectories),
    ] = "ellipse",
    laps: Annotated[int, typer.Option(min=1, max=100, help="With --demo: laps of ellipse or figure8.")] = 2,
    period: Annotated[
        float, typer.Option(min=4.0, max=120.0, help="With --demo: time for one lap at full speed, s.")
    ] = 15.0,
    size: Annotated[
        float, typer.Option(min=0.1, max=3.0, help="With --demo: scale of ellipse or figure8; 1 is 2 m long.")
    ] = 1.0,
    arms: Annotated[
        str,
        typer.Option(
            help="With --demo: swing, off, another name in config/arms/, or a file of joint motion.",
            autocompletion=motions_or_off,
        ),
    ] = "swing",
    config: Annotated[
        Path | None, typer.Option(help="With --demo: companion configuration.  [default: config/demo.toml]")
    ] = None,
    mock_config: Annotated[
        Path | None, typer.Option(help="With --demo: mock configuration.  [default: config/mock.toml]")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write a picture and a record of each flight into this folder.")
    ] = None,
    summary: SummaryFile = None,
) -> None:
    """Fly an experiment in virtual time, as fast as this computer can, and print the errors.

    Control, estimation and limits are the flight software's; vehicle and room are the mock's. The same seed gives the
    same flight. Exit codes: 0 every flight inside the controller's error limits, 1 not so, 2 could not be started,
    130 after Ctrl-C.
    """
    begun_s = time.perf_counter()
    console = Console()
    _refuse_mixtures(context, demo)
    check_link(law_on, link)
    check_output(out, summary)
    numbers = [seed] if seeds is None else list(seeds_of(seeds))
    if demo:
        settings = load_config(config or default_config_path("demo.toml"))
        curve = trajectory_named(trajectory, Curve(laps, period, size, settings.flight.takeoff_height_m))
        check_trajectory(curve, settings.room, trajectory)
        mock = load_mock(mock_config or default_config_path("mock.toml"))
        scene = demo_scene(f"demo-{Path(trajectory).stem}", curve, arms, settings, mock)
    else:
        scene = load_scene(experiment)
    scene = scene if bandwidth is None else scene.with_bandwidth(bandwidth)
    scene = scene if horizon is None else scene.with_horizon(horizon)
    scene = scene.with_radio(radio_named(link)) if law_on is Place.GROUND else scene
    law = _controller(scene, controller, allow_unstable, ablate)
    try:
        flights = _fly(_Request(scene, law, feedforward, numbers, out is not None), begun_s, console)
    except KeyboardInterrupt:
        console.print("[yellow]interrupted[/]: nothing was written")
        raise typer.Exit(INTERRUPTED) from None
    print_flights(flights, console)
    if out is not None:
        keep_flights(flights, out, console)
    if summary is not None:
        summary.write_text(json.dumps(summary_of(flights), indent=2) + "\n", encoding="utf-8")
    raise typer.Exit(0 if flights.good else FAILED)


def _refuse_mixtures(context: typer.Context, demo: bool) -> None:
    sources = {name: context.get_parameter_source(name) for name in context.params}
    given = {name for name, source in sources.items() if source is not None and source.name != "DEFAULT"}
    if demo and "experiment" in given:
        raise ConfigError(f"{context.params['experiment']}: an experiment or --demo, not both")
    strays = [name for name in _DEMO_ONLY if name in given]
    if strays and not demo:
        option = strays[0].replace("_", "-")
        raise ConfigError(f"--{option} is only for --demo: an experiment's file defines its flight")
    if {"seed", "seeds"} <= given:
        raise ConfigError("--seed and --seeds: give one of them")


def _controller(scene: Scene, name: str | None, allow_unstable: bool, ablation: Ablation | None) -> LoadedController:
    chosen, model = name or scene.companion.control.controller, scene.vehicle_model()
    if ablation is not None:
        return load_ablated(chosen, model, scene.period_s, ablation)
    law = load_controller(chosen, model, scene.period_s, allow_unstable)
    require_margin(law, model, scene.period_s)
    return law


@dataclass(frozen=True)
class _Request:
    """Request of a simulation: scene, law, seeds."""

    scene: Scene
    controller: LoadedController
    feedforward: Feedforward | None
    seeds: list[int]
    keep_signals: bool


def _fly(request: _Request, begun_s: float, console: Console) -> Flights:
    """Fly all seeds as one batch with a progress bar; `begun_s` is when the command began."""
    scene, law, seeds = request.scene, request.controller.law, request.seeds
    pilot, vehicle = scene.pilot(request.controller, request.feedforward), scene.vehicle()
    mission = scene.mission(law.preview_s)
    if len(seeds) > 1:
        mission = stacked([mission] * len(seeds))
    with progress_bar(console) as bar:
        task = bar.add_task(f"{scene.name}, {request.controller.name}", total=len(mission.time_s))

        def show(cycle: int) -> None:
            if cycle % _SHOWN_CYCLES == 0:
                bar.update(task, completed=cycle)

        ready_s = time.perf_counter()
        with in_flight(request.controller.own_file):
            trace = fly(pilot, vehicle, mission, seeds, keep_signals=request.keep_signals, progress=show)
        end_s = time.perf_counter()
    return flights_of(scene, request.controller, seeds, trace, end_s - ready_s, end_s - begun_s)
