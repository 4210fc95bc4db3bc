"""`python -m benchmarks`: latency beside a bare relay, steps, CPU, memory, arms' bus, record, page; see `--help`."""

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
import uvloop
from rich.console import Console
from rich.status import Status

from benchmarks.arms import measure_arms
from benchmarks.flights import measure_footprint, measure_latency
from benchmarks.flood import measure_flood
from benchmarks.machine import this_machine
from benchmarks.onlookers import measure_onlookers
from benchmarks.results import Results, as_markdown, print_results
from benchmarks.steps import cycle_cost, stage_costs, step_costs
from benchmarks.virtual import measure_virtual
from companion.config.companion_config import load_config
from companion.config.locations import default_config_path
from companion.core.interfaces import CompanionError

RESULTS = Path(__file__).with_name("RESULTS.md")
RATES_HZ = (100.0, 250.0)
PAGES = 200


class Part(StrEnum):
    """Parts of the benchmark that can run alone."""

    LATENCY = "latency"
    STEPS = "steps"
    VIRTUAL = "virtual"
    PROCESS = "process"
    ARMS = "arms"
    RECORDS = "records"
    PAGE = "page"


def bench(
    quick: Annotated[bool, typer.Option("--quick", help="Under 20 s: 100 Hz only, short flights, few rounds.")] = False,
    only: Annotated[Part | None, typer.Option(help="Measure this part alone.")] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write everything to this file, too.")] = None,
    write_results: Annotated[bool, typer.Option("--write-results", help="Write benchmarks/RESULTS.md.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit code 1 when a target is missed.")] = False,
) -> None:
    """Measure what has a target, and say whether it is met. Exit code 2 when nothing could be measured."""
    console = Console()
    try:
        results = _measure(console, quick, set(Part) if only is None else {only})
    except CompanionError as error:
        console.print(f"[bold red]{error}[/]")
        raise typer.Exit(2) from error
    print_results(results, console)
    if json_file is not None:
        json_file.write_text(json.dumps(results.as_dict(), indent=2) + "\n", encoding="utf-8")
    if write_results:
        RESULTS.write_text(as_markdown(results), encoding="utf-8")
    missed = [target for target in results.targets() if not target.met]
    raise typer.Exit(1 if strict and missed else 0)


def _measure(console: Console, quick: bool, parts: set[Part]) -> Results:
    results = Results(this_machine(), quick)
    with console.status("starting") as status:
        if Part.STEPS in parts:
            _steps(results, status)
        if Part.VIRTUAL in parts:
            _virtual(results, status)
        if Part.LATENCY in parts:
            _latency(results, status)
        if Part.PROCESS in parts:
            _process(results, status)
        if Part.ARMS in parts:
            _arms(results, status)
        if Part.RECORDS in parts:
            _records(results, status)
        if Part.PAGE in parts:
            _pages(results, status)
    return results


def _steps(results: Results, status: Status) -> None:
    config, rounds = load_config(default_config_path("demo.toml")), 3 if results.quick else 15
    for step in step_costs(config, rounds):
        results.steps.append(step)
        status.update(f"control steps: {step.law}, {step.vehicles} vehicles done")
    for stage in stage_costs(config, rounds):
        results.stages.append(stage)
        status.update(f"stages: {stage.stage} done")
    results.cycles.append(cycle_cost(config, min(rounds, 5)))


def _virtual(results: Results, status: Status) -> None:
    flights, vehicles = (10, 100) if results.quick else (50, 4000)
    results.virtual.append(measure_virtual(flights, vehicles, lambda what: status.update(f"virtual time: {what}")))


def _latency(results: Results, status: Status) -> None:
    for rate_hz in RATES_HZ[:1] if results.quick else RATES_HZ:

        def say(what: str, rate_hz: float = rate_hz) -> None:
            status.update(f"latency at {rate_hz:g} Hz: {what}")

        results.latencies.append(uvloop.run(measure_latency(rate_hz, 3.0 if results.quick else 20.0, say)))


def _process(results: Results, status: Status) -> None:
    if results.quick and results.latencies:
        return  # a second flight would not be quick
    results.footprints.append(
        uvloop.run(measure_footprint(RATES_HZ[0], 20.0, lambda what: status.update(f"CPU and memory: {what}")))
    )


def _arms(results: Results, status: Status) -> None:
    turns, for_s = (2, 1.0) if results.quick else (6, 5.0)
    results.arms.append(uvloop.run(measure_arms(turns, for_s, lambda what: status.update(f"arms: {what}"))))


def _records(results: Results, status: Status) -> None:
    for_s = 6.0 if results.quick else 30.0
    measured = measure_onlookers(RATES_HZ[0], for_s, lambda what: status.update(f"record and telemetry: {what}"))
    results.onlookers.append(uvloop.run(measured))


def _pages(results: Results, status: Status) -> None:
    turns = [1.0, 1.0] if results.quick else [5.0] * 6
    measured = measure_flood(RATES_HZ[0], PAGES, turns, lambda what: status.update(f"open pages: {what}"))
    results.floods.append(uvloop.run(measured))


if __name__ == "__main__":
    typer.run(bench)
