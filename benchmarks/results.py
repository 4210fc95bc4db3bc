"""All that one run found, and its forms: tables for the terminal, JSON, and RESULTS.md."""

from dataclasses import asdict, dataclass, field
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.arms import ArmsCost
from benchmarks.flights import Footprint, Latency
from benchmarks.flood import FloodCost
from benchmarks.machine import Machine
from benchmarks.onlookers import OnlookersCost
from benchmarks.steps import CycleCost, StageCost, StepCost
from benchmarks.targets import (
    Target,
    arms_targets,
    cycle_targets,
    flood_targets,
    footprint_targets,
    latency_targets,
    onlookers_targets,
    step_targets,
    virtual_targets,
)
from benchmarks.virtual import VirtualCost

Row = tuple[str, ...]
Section = tuple[str, Row, list[Row]]
"""Title, column heads, rows."""


@dataclass
class Results:
    """Filled section by section; what was not measured is empty."""

    machine: Machine
    quick: bool
    latencies: list[Latency] = field(default_factory=list)
    steps: list[StepCost] = field(default_factory=list)
    stages: list[StageCost] = field(default_factory=list)
    cycles: list[CycleCost] = field(default_factory=list)
    virtual: list[VirtualCost] = field(default_factory=list)
    footprints: list[Footprint] = field(default_factory=list)
    arms: list[ArmsCost] = field(default_factory=list)
    onlookers: list[OnlookersCost] = field(default_factory=list)
    floods: list[FloodCost] = field(default_factory=list)

    def targets(self) -> list[Target]:
        """Every target that this run can speak of."""
        return [
            *(target for latency in self.latencies for target in latency_targets(latency)),
            *step_targets(self.steps),
            *(target for cycle in self.cycles for target in cycle_targets(cycle)),
            *(target for cost in self.virtual for target in virtual_targets(cost)),
            *(target for footprint in self.footprints for target in footprint_targets(footprint)),
            *(target for cost in self.arms for target in arms_targets(cost)),
            *(target for onlookers in self.onlookers for target in onlookers_targets(onlookers)),
            *(target for flood in self.floods for target in flood_targets(flood)),
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return the results as a dictionary for JSON."""
        targets = [asdict(target) | {"met": target.met} for target in self.targets()]
        ratios = [latency.ratio for latency in self.latencies]
        return asdict(self) | {"targets": targets, "latency_over_relay": ratios}

    def sections(self) -> list[Section]:
        """Return the tables of all sections as text."""
        steps = (self._latencies(), self._steps(), self._stages(), self._cycles(), self._virtual())
        tables = (self._targets(), *steps, self._footprints(), self._arms(), self._onlookers(), self._floods())
        return [table for table in tables if table[2]]

    def _targets(self) -> Section:
        rows: list[Row] = [
            (t.name, _number(t.value, t.unit), t.wanted, "pass" if t.met else "FAIL") for t in self.targets()
        ]
        return "Targets", ("what", "measured", "wanted", ""), rows

    def _latencies(self) -> Section:
        rows = [
            (
                f"{name}, {latency.rate_hz:g} Hz",
                *(f"{value:.0f}" for value in (s.least, s.median, s.p90, s.p99, s.most)),
            )
            for latency in self.latencies
            for name, s in (
                ("service", latency.service_us),
                ("  frame sent to frame received", latency.arrival_us),
                ("  frame received to setpoint sent", latency.inside_us),
                ("bare relay", latency.relay_us),
            )
        ]
        return "Frame to setpoint, us", ("", "least", "median", "p90", "p99", "most"), rows

    def _steps(self) -> Section:
        rows: list[Row] = [(c.law, f"{c.vehicles}", f"{c.step_us:.1f}", f"{c.vehicle_us:.3f}") for c in self.steps]
        return "One control step, us", ("law", "vehicles", "a step", "a vehicle"), rows

    def _stages(self) -> Section:
        rows: list[Row] = [(c.stage, f"{c.call_us:.1f}") for c in self.stages]
        return "Stages, one vehicle, us", ("stage", "median"), rows

    def _cycles(self) -> Section:
        rows: list[Row] = [(f"{c.python_us:.1f}", f"{c.flown_us:.1f}", f"{c.ratio:.2f}") for c in self.cycles]
        return "Estimator, law, conversion, limits after a sleep, us", ("in Python", "as in flight", "ratio"), rows

    def _virtual(self) -> Section:
        rows: list[Row] = [
            (
                f"{c.side_by_side} side by side" if c.compiled else "no",
                f"{c.times_real:.0f}",
                f"{c.command_s:.2f} s",
                f"{c.vehicles}",
                f"{c.vehicle_s_per_minute:.0f}",
            )
            for c in self.virtual
        ]
        flight = ("one flight, times real time", "companion simulate, processor time")
        heads = ("compiled", *flight, "vehicles of a sweep", "vehicle-seconds a minute")
        return "Virtual time", heads, rows

    def _footprints(self) -> Section:
        rows: list[Row] = [
            (f"{f.rate_hz:g} Hz", f"{100 * f.cpu_share:.1f} %", f"{f.memory_mb:.0f} MB", f"{f.setpoints_per_s:.1f}")
            for f in self.footprints
        ]
        return "The service's process in flight", ("loop", "of a core", "memory", "setpoints a second"), rows

    def _arms(self) -> Section:
        rows = [
            (name, *(f"{scale * value:.0f}" for value in (s.least, s.median, s.p90, s.p99, s.most)))
            for cost in self.arms
            for name, scale, s in (
                (f"bus cycle, {cost.rate_hz:.0f} Hz, {100 * cost.cpu_share:.0f} % of a core", 1e3, cost.cycle_ms),
                ("frame sent to tick begun, without arms", 1.0, cost.late_without_us),
                ("  with arms", 1.0, cost.late_us),
                ("frame sent to tick done, without arms", 1.0, cost.done_without_us),
                ("  with arms", 1.0, cost.done_us),
            )
        ]
        return "The arms' bus, and the tick beside it, us", ("", "least", "median", "p90", "p99", "most"), rows

    def _onlookers(self) -> Section:
        rows = [
            (f"{name}, {cost.rate_hz:g} Hz", *(f"{v:.0f}" for v in (s.least, s.median, s.p90, s.p99, s.most)))
            for cost in self.onlookers
            for name, s in (
                ("nobody looks on", cost.alone_us),
                ("record", cost.record_us),
                ("record and telemetry", cost.all_us),
            )
        ]
        return "A whole tick, us, by who looks on", ("", "least", "median", "p90", "p99", "most"), rows

    def _floods(self) -> Section:
        rows = [
            (name, *(f"{value:.0f}" for value in (s.least, s.median, s.p90, s.p99, s.most, lost)))
            for cost in self.floods
            for name, s, lost in (
                (f"no page open, {cost.rate_hz:g} Hz", cost.alone_us, cost.dropped_alone),
                (f"{cost.pages} pages open, {cost.rate_hz:g} Hz", cost.flooded_us, cost.dropped),
            )
        ]
        return "A whole tick, us, by open pages", ("", "least", "median", "p90", "p99", "most", "frames dropped"), rows


def _number(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}".strip()


def print_results(results: Results, console: Console) -> None:
    """Return the results as tables for the terminal."""
    for title, heads, rows in results.sections():
        table = Table(title=title, title_justify="left")
        for place, head in enumerate(heads):
            table.add_column(head, justify="left" if place == 0 else "right")
        for row in rows:
            style = {"pass": "green", "FAIL": "bold red"}.get(row[-1])
            table.add_row(*row, style=style)
        console.print(table)


def as_markdown(results: Results) -> str:
    """Return the results as the text of RESULTS.md."""
    m = results.machine
    packages = ", ".join(f"{name} {version}" for name, version in m.packages.items())
    load = ", ".join(f"{value:.1f}" for value in m.load_at_start)
    lines = [
        "# Benchmark results",
        "",
        f"The last run of `make bench ARGS=--write-results`{' with --quick' if results.quick else ''}, as it came out.",
        "",
        f"- {m.date}",
        f"- {m.cpu}, {m.cores} cores, {m.memory_gb:g} GB, {m.kernel}",
        f"- {m.python}; {packages}",
        f"- load average at the start (1, 5, 15 min): {load}",
        "",
    ]
    for title, heads, rows in results.sections():
        lines += [f"## {title}", "", *_markdown_table(heads, rows), ""]
    return "\n".join([*lines, *_NOTES])


def _markdown_table(heads: Row, rows: list[Row]) -> list[str]:
    rule = "|".join("---" if place == 0 else "---:" for place in range(len(heads)))
    return [f"| {' | '.join(heads)} |", f"|{rule}|", *(f"| {' | '.join(row)} |" for row in rows)]


_NOTES = """## How it is measured

- **Frame to setpoint**: the mocks run in the benchmark's process, the service in its own, hovering under
  `practical.toml` with `every_cycle`. A frame's time is taken just before it is sent by UDP; a setpoint's is the
  kernel's stamp on the autopilot's socket. Each frame is answered by the first setpoint before the next frame.
- **Bare relay**: a third process; receive, read the pose, pack SET_ATTITUDE_TARGET with pymavlink, send. It gets the
  same datagrams half a period later, so both see the same seconds of the same machine.
- **Steps and stages**: median of single calls, of the calmest of several rounds, in a loop with nothing else: caches
  are warm and the clock is up. A control loop sleeps most of its period; what that costs is in the rows "asleep", and
  in every latency here. It depends on the machine more than on the code (virtual machines and power saving are worst).
- **Arms**: eight simulated servos (6 XM, 2 AX) on a pty, in another process that sends the frames, too. The tick is
  law, conversion and gate; with arms, their status and new goals, too. Turns with the bus and without alternate. The
  servos' simulation shares the two cores, which real servos do not.
- **Who looks on**: whole ticks of one hover, each ten under one group of onlookers, then the next. Rows of the record
  are encoded ten at a time, after the setpoint has left: the median does not show that tick, the 90th percentile does.
- **Open pages**: one hover with the embedded broker and the page's server beside it, in turns without a page and with
  200 of them open, which read every message. Service, mocks, broker, server and pages share the cores; the service has
  the real-time priority that systemd gives it, where the benchmark may take it, and the mocks one below. A frame that
  the mocks sent together with the next one is not counted as dropped.
- **Process**: `psutil` over a hover under `practical.toml`; the mocks are not in it.
""".splitlines()
