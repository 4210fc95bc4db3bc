"""`companion demo --vehicles N`: several vehicles, from the options to the exit code."""

import json
from contextlib import ExitStack
from datetime import UTC, datetime
from typing import Any

import numpy as np
import typer
import uvloop
from rich.console import Console

from companion.analysis.summary import Summary
from companion.cli.demo.fleet.flight import FleetFlight, FleetFlown, fly_fleet
from companion.cli.demo.fleet.mission import lap_waypoints
from companion.cli.demo.fleet.options import FleetOptions
from companion.cli.demo.fleet.report import Separated, VehicleReport, as_dict, plot_fleet, read_reports, separations
from companion.cli.demo.fleet.room import RoomPlan, plan_room
from companion.cli.demo.flight_report import summary_dict, within_limits
from companion.cli.demo.page import page_of_demo
from companion.cli.operator.exit_codes import FAILED, INTERRUPTED
from companion.cli.output import as_typed, kept
from companion.cli.terminal import numbers_table
from companion.core.interfaces import CompanionError
from companion.service.trajectory_space import require_inside
from companion.trajectories.waypoints import Waypoints

_LAPS = "laps side by side"


def fly(options: FleetOptions, console: Console) -> int:
    """Fly the demo, print what came of it, write picture and summary; return the exit code."""
    plan = plan_room(options.settings, options.vehicles, options.out, options.free_ports)
    _check_laps(plan, options.laps)
    flight = FleetFlight(
        plan=plan,
        mock_config=options.mock_config,
        seed=options.seed,
        faults=options.faults,
        laps=options.laps,
        arms=options.arms,
        records=options.out,
        stay_s=options.stay_s,
    )
    try:
        with ExitStack() as page:
            if options.page:
                page.enter_context(page_of_demo(plan.configs[0], options.free_ports, console))
            flown = uvloop.run(fly_fleet(flight, console, page.close))
    except KeyboardInterrupt:
        console.print("[yellow]interrupted[/] before the flight")
        return INTERRUPTED
    return _conclude(options, plan, flown, console)


def _check_laps(plan: RoomPlan, laps: int) -> None:
    """Raise ConfigError or FlightError where a vehicle's laps leave the room, before anything starts."""
    config = plan.configs[0]
    for index, name in enumerate(plan.names):
        rows = lap_waypoints(plan.lane_y_m(index), config.flight.takeoff_height_m, laps)
        path = Waypoints(rows[:, 0], rows[:, 1:], np.zeros(len(rows)))
        require_inside(path, config.room, config.fence, f"{name}'s laps")


def _conclude(options: FleetOptions, plan: RoomPlan, flown: FleetFlown, console: Console) -> int:
    try:
        reports = read_reports({name: flown.records[name] for name in plan.names if name in flown.records})
    except CompanionError as error:
        reports, flown.failure = (), "; ".join(filter(None, (flown.failure, str(error))))
    pairs = separations(reports, plan.separation)
    wrong = _wrong(options, plan, flown, reports, pairs)
    _print(options, plan, reports, pairs, console)
    for sentence in wrong:
        console.print(f"  {sentence}", style="red", markup=False, highlight=False, soft_wrap=True)
    if flown.interrupted:
        console.print("interrupted", style="yellow", highlight=False)
    if not wrong:
        console.print(f"all {len(plan.names)} vehicles landed and disarmed", style="green", highlight=False)
    _keep(options, plan, reports, pairs, console)
    _write_summary(options, flown, reports, pairs)
    if flown.interrupted:
        return INTERRUPTED
    return FAILED if wrong else 0


def _wrong(
    options: FleetOptions,
    plan: RoomPlan,
    flown: FleetFlown,
    reports: tuple[VehicleReport, ...],
    pairs: tuple[Separated, ...],
) -> list[str]:
    """Return a sentence for everything that did not go as planned."""
    said = [flown.failure] if flown.failure else []
    said += [f"collision: {who}" for who in flown.collisions]
    said += [f"{name} is not known to be down and disarmed" for name in plan.names if not flown.landed.get(name)]
    least_m = plan.separation.radius_m
    said += [
        f"{' and '.join(pair.names)} came within {pair.least_m:.2f} m, at least {least_m:g} m are wanted"
        for pair in pairs
        if pair.least_m < least_m
    ]
    limits = options.law.error_limits
    flew = [report for report in reports if report.summary is not None]
    said += [
        f"{report.name} left the error limits of {options.law.name}, or has not landed"
        for report in flew
        if not within_limits(report.summary, limits)
    ]
    return said


def _print(
    options: FleetOptions,
    plan: RoomPlan,
    reports: tuple[VehicleReport, ...],
    pairs: tuple[Separated, ...],
    console: Console,
) -> None:
    rows = [(report.name, *_row(report.summary)) for report in reports if report.summary is not None]
    if rows:
        limits = options.law.error_limits
        rows.append(("limit", f"{100.0 * limits.mean_m:.1f}", f"{100.0 * limits.max_m:.1f}", "", "", ""))
        columns = ("vehicle", "mean error (cm)", "largest (cm)", "updates", "tick late (ms)", "99 % (ms)")
        console.print(numbers_table(f"{_LAPS}, law {options.law.name}", columns, rows))
    for pair in pairs:
        if np.isfinite(pair.least_m):
            console.print(
                f"least separation of {' and '.join(pair.names)}: {pair.least_m:.2f} m "
                f"(at least {plan.separation.radius_m:g} m wanted)",
                highlight=False,
                soft_wrap=True,
            )


def _row(summary: Summary | None) -> tuple[str, ...]:
    assert summary is not None
    late = summary.tick_late_ms
    return (
        f"{100.0 * max(summary.mean_error_m):.1f}",
        f"{100.0 * max(summary.max_error_m):.1f}",
        f"{summary.update_share:.0%}",
        f"{late.median:.2f}",
        f"{late.p99:.2f}",
    )


def _keep(
    options: FleetOptions,
    plan: RoomPlan,
    reports: tuple[VehicleReport, ...],
    pairs: tuple[Separated, ...],
    console: Console,
) -> None:
    """Write the picture, and name it and the records."""
    if not reports:
        return
    when = f"{datetime.now(tz=UTC).astimezone():%Y%m%d-%H%M%S}"
    picture = options.out / f"{when}-{len(plan.names)}-vehicles-seed{options.seed}.png"
    lost = kept(picture, lambda path: plot_fleet(reports, pairs, plan.separation, path))
    if lost:
        typer.echo(f"companion: {lost}", err=True)
    records = " ".join(str(report.path) for report in reports)
    words = "" if lost else f"plot {picture}, "
    console.print(f"{words}records {records}", markup=False, highlight=False, soft_wrap=True)
    console.print(f"next: {as_typed()} report {records}", markup=False, highlight=False, soft_wrap=True)


def _write_summary(
    options: FleetOptions, flown: FleetFlown, reports: tuple[VehicleReport, ...], pairs: tuple[Separated, ...]
) -> None:
    if options.summary is None:
        return
    data: dict[str, Any] = {
        "vehicles": {report.name: summary_dict(_LAPS, options.law.name, report.summary) for report in reports},
        **as_dict(reports, pairs),
        "collisions": flown.collisions,
        "failure": flown.failure,
    }
    options.summary.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
