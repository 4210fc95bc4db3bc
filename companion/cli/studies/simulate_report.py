"""Results of virtual flights: tables, JSON, pictures and records."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console, Group
from rich.markup import escape

from companion.analysis.summary import summarise
from companion.cli.demo.flight_report import ErrorRow, error_table
from companion.config.controller_config import LoadedController
from companion.core.types import Array
from companion.simulation.link_numbers import LinkNumbers, link_numbers
from companion.simulation.metrics import LOST_M, Score, score
from companion.simulation.scene import Scene
from companion.simulation.simulation import Trace
from companion.simulation.virtual_record import columns_of, one_of, until_lost
from companion.simulation.virtual_world import STEP_S


@dataclass(frozen=True)
class Flights:
    """Results of virtual flights, one for each seed."""

    scene: Scene
    controller: LoadedController
    seeds: list[int]
    traces: list[Trace]
    loop_s: float
    """Computing time of the flights."""
    total_s: float
    """Computing time including preparation."""

    @property
    def scores(self) -> list[Score]:
        """The score of each flight."""
        return [score(trace) for trace in self.traces]

    @property
    def flown_s(self) -> float:
        """The virtual time of all flights together."""
        return sum(len(trace.time_s) for trace in self.traces) * self.scene.period_s

    @property
    def link(self) -> LinkNumbers | None:
        """The numbers of the link to a law on the ground; None for one on board."""
        return link_numbers(self.traces, self.scene.period_s)

    @property
    def diverged(self) -> int:
        """The number of flights that diverged."""
        return sum(bool(one.diverged) for one in self.scores)

    @property
    def good(self) -> bool:
        """True if every flight stayed inside the controller's error limits."""
        limits = self.controller.error_limits
        small = all(
            (one.mean_error_m <= limits.mean_m).all() and (one.max_error_m <= limits.max_m).all() for one in self.scores
        )
        return small and not self.diverged and not any(bool(one.landed) for one in self.scores)


def flights_of(
    scene: Scene, controller: LoadedController, seeds: list[int], trace: Trace, loop_s: float, total_s: float
) -> Flights:
    """Split a batch into flights; `trace` has axes (cycles, seeds), or (cycles,) for one seed."""
    traces = [one_of(trace, number) for number in range(len(seeds))] if len(seeds) > 1 else [trace]
    return Flights(scene, controller, seeds, traces, loop_s, total_s)


def print_flights(flights: Flights, console: Console) -> None:
    """Print errors, updates, computing speed and the verdict."""
    scores, times = flights.scores, flights.flown_s / flights.loop_s
    sent, events = (float(np.mean([getattr(one, name) for one in scores])) for name in ("update_share", "event_share"))
    console.print(_table(flights))
    link = flights.link
    for line in (
        *([] if link is None else [str(link)]),
        f"updates in {sent:.1%} of the cycles; the law's trigger fired in {events:.1%}",
        f"{flights.flown_s:.0f} s of flight in {flights.loop_s:.2f} s: {times:.0f} times faster than real time, "
        f"{flights.flown_s / flights.total_s:.0f} times including preparation",
        _verdict(flights),
    ):
        console.print(line, highlight=False, soft_wrap=True)


def _verdict(flights: Flights) -> str:
    if flights.diverged:
        which = (
            "diverged" if len(flights.seeds) == 1 else f"{flights.diverged} of {len(flights.seeds)} flights diverged"
        )
        return f"[red]{which}: more than {LOST_M:g} m from the reference[/]"
    landed = [f"{time_s:.1f} s" for time_s in flights.link.landed_s] if flights.link else []
    if landed:
        times = ", ".join(landed)
        return (
            f"[red]landed by PX4: {len(landed)} of {len(flights.seeds)}[/], as nothing came from the ground ({times})"
        )
    return "[green]inside the error limits[/]" if flights.good else "[red]outside the error limits[/]"


def _table(flights: Flights) -> Group:
    limits, seeds = flights.controller.error_limits, flights.seeds
    which = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    title = f"tracking error, {flights.scene.name}, {Path(flights.controller.name).name}, {which}"
    mean, largest = (
        np.array([getattr(one, name) for one in flights.scores]) for name in ("mean_error_m", "max_error_m")
    )
    rows: list[ErrorRow] = [("mean", mean.mean(axis=0), limits.mean_m), ("max", largest.max(axis=0), limits.max_m)]
    if len(seeds) > 1:
        rows.insert(1, ("worst flight's mean", mean.max(axis=0), limits.mean_m))
    return error_table(title, rows)


def summary_of(flights: Flights) -> dict[str, Any]:
    """Return the content of --summary: averages over the flights, and each flight's numbers."""
    each = [_numbers_of(one) for one in flights.scores]
    names = {"experiment": flights.scene.name, "controller": flights.controller.name}
    averages = {name: np.mean([numbers[name] for numbers in each], axis=0) for name in each[0]}
    return (
        names
        | _plain(averages)
        | {
            "diverged": flights.diverged,
            "inside_limits": flights.good,
            "control_cycles": int((flights.traces[0].time_s >= 0.0).sum()),
            **({} if flights.link is None else {"link": flights.link.plain()}),
            "times_real_time": flights.flown_s / flights.loop_s,
            "flights": [{"seed": seed} | _plain(numbers) for seed, numbers in zip(flights.seeds, each, strict=True)],
        }
    )


def _numbers_of(one: Score) -> dict[str, Array]:
    return {
        name: getattr(one, name) for name in ("mean_error_m", "max_error_m", "error_m", "update_share", "event_share")
    }


def _plain(numbers: dict[str, Array]) -> dict[str, Any]:
    """Convert arrays for JSON, with null for values that are not finite."""
    with_nulls = {name: np.asarray(value, dtype=object) for name, value in numbers.items()}
    for name, value in numbers.items():
        with_nulls[name][~np.isfinite(value)] = None
    return {name: value.tolist() for name, value in with_nulls.items()}


def keep_flights(flights: Flights, folder: Path, console: Console) -> None:
    """Write a picture and a record of each flight, with the columns of a real flight's record."""
    from companion.analysis.plots import plot_flight  # noqa: PLC0415 - matplotlib takes a second to import

    controller = Path(flights.controller.name).stem.replace(" ", "-")
    joints_rad = _joints_rad(flights)
    for seed, trace in zip(flights.seeds, flights.traces, strict=True):
        names = {"law_name": np.full(len(trace.time_s), flights.controller.name)}
        columns = columns_of(trace, joints_rad) | names
        path = folder / f"virtual-{flights.scene.name}-{controller}-seed{seed}"
        title = f"{flights.scene.name} in virtual time, controller {Path(flights.controller.name).name}, seed {seed}"
        shown_columns = until_lost(columns)
        if len(shown_columns["time_s"]) < len(columns["time_s"]):
            title += f": lost after {shown_columns['time_s'][-1] - 1.0:.1f} s"
        with console.status("drawing"):
            plot_flight(shown_columns, summarise(columns), title, Path(f"{path}.png"))
            np.savez_compressed(f"{path}.npz", **columns)
        shown = escape(str(path))
        console.print(f"plot [bold]{shown}.png[/], record {shown}.npz", soft_wrap=True)


def _joints_rad(flights: Flights) -> Array | None:
    """Return the true joint angles of each cycle, (n, 8); None without arms."""
    arms = flights.scene.vehicle().arms
    if arms is None:
        return None
    per_cycle = round(flights.scene.period_s / STEP_S)
    return np.asarray(arms.table.joints_rad[::per_cycle][: len(flights.traces[0].time_s)])
