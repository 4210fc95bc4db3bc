"""The end of a flight in numbers: a table for people, JSON for programs."""

import math
from dataclasses import asdict
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from companion.analysis.summary import ArmSummary, Summary
from companion.config.controller_config import ErrorLimits, LoadedController


def within_limits(summary: Summary | None, limits: ErrorLimits) -> bool:
    """Return whether the vehicle landed, disarmed and stayed inside the error limits on every axis."""
    if summary is None or not (summary.landed and summary.disarmed):
        return False
    return max(summary.mean_error_m) <= limits.mean_m and max(summary.max_error_m) <= limits.max_m


def summary_dict(trajectory: str, controller: str, summary: Summary | None) -> dict[str, Any]:
    """Return the content of --summary: the names, and the numbers of a flight that flew."""
    names: dict[str, Any] = {"trajectory": trajectory, "controller": controller}
    if summary is None:
        return names | {"landed": False, "disarmed": False}
    return names | {
        "mean_error_m": list(summary.mean_error_m),
        "max_error_m": list(summary.max_error_m),
        "rms_error_m": list(summary.rms_error_m),
        "update_share": summary.update_share,
        "control_cycles": summary.control_cycles,
        "cycles_without_frame": summary.cycles_without_frame,
        "tick_late_ms": summary.tick_late_ms.as_dict(),
        "frame_to_setpoint_ms": summary.frame_to_setpoint_ms.as_dict(),
        "capture_to_setpoint_ms": summary.capture_to_setpoint_ms.as_dict(),
        "landed": summary.landed,
        "disarmed": summary.disarmed,
        "arms": None if summary.arms is None else asdict(summary.arms),
    }


def print_report(
    console: Console, controller: LoadedController, summary: Summary | None, failure: str, interrupted: bool
) -> None:
    """Print tables of errors and timing, the controller's description and the verdict."""
    if summary is not None:
        console.print(_error_table(controller, summary))
        if controller.description:
            console.print(f"{controller.name}: {controller.description}", markup=False, highlight=False, soft_wrap=True)
        console.print(_timing_table(summary))
        if summary.arms is not None:
            console.print(_arms_line(summary.arms), highlight=False, soft_wrap=True)
    verdict = Text.assemble(("interrupted", "yellow"), "; ") if interrupted else Text()
    console.print(verdict + _verdict(controller, summary, failure), highlight=False, soft_wrap=True)


def print_comparison(console: Console, flights: list[tuple[str, Summary | None]]) -> None:
    """Print a table of several controllers on one trajectory, with the first one's reduction against the last."""
    table = Table(title="side by side, errors in cm", title_justify="left")
    for name in ("controller", "mean x", "y", "z", "max x", "y", "z", "updates"):
        table.add_column(name, justify="left" if name == "controller" else "right")
    for name, summary in flights:
        if summary is not None:
            errors = [f"{100.0 * value:.2f}" for value in (*summary.mean_error_m, *summary.max_error_m)]
            table.add_row(escape(name), *errors, f"{summary.update_share:.1%}")
    (_, first), (_, last) = flights[0], flights[-1]
    if first is not None and last is not None:
        pairs = zip((*first.mean_error_m, *first.max_error_m), (*last.mean_error_m, *last.max_error_m), strict=True)
        table.add_row("reduced by", *(f"{1.0 - mine / other:.0%}" for mine, other in pairs), "")
    console.print(table)


def _error_table(controller: LoadedController, summary: Summary) -> Table:
    limits = controller.error_limits
    table = Table(title=f"tracking error, {escape(controller.name)}", title_justify="left")
    for name in ("cm", "x", "y", "z", "limit"):
        table.add_column(name, justify="left" if name == "cm" else "right")
    for name, values, limit in (
        ("mean", summary.mean_error_m, limits.mean_m),
        ("RMS", summary.rms_error_m, None),
        ("max", summary.max_error_m, limits.max_m),
    ):
        cells = [error_cell(value, limit) for value in values]
        table.add_row(name, *cells, "" if limit is None else f"{100.0 * limit:g}")
    return table


def error_cell(error_m: float, limit_m: float | None) -> str:
    """Return an error in cm for a table; red beyond its limit."""
    text = f"{100.0 * error_m:.2f}"
    return text if limit_m is None or error_m <= limit_m else f"[red]{text}[/]"


def _timing_table(summary: Summary) -> Table:
    table = Table(
        title=f"updates in {summary.update_share:.1%} of {summary.control_cycles} cycles", title_justify="left"
    )
    for name in ("timing (ms)", "median", "p99"):
        table.add_column(name, justify="left" if "(" in name else "right")
    for name, spread in (
        ("tick late", summary.tick_late_ms),
        ("frame arrival to setpoint", summary.frame_to_setpoint_ms),
        ("frame capture to setpoint", summary.capture_to_setpoint_ms),
    ):
        table.add_row(name, f"{spread.median:.2f}", f"{spread.p99:.2f}")
    return table


def _arms_line(arms: ArmSummary) -> str:
    did = "moving" if arms.moving_share > 0.0 else "still"
    off_deg = math.degrees(arms.largest_off_goal_rad)
    return (
        f"arms {did}, joints within {off_deg:.1f}° of their goals; bus cycle {arms.bus_cycle_ms.median:.1f} ms "
        f"(p99 {arms.bus_cycle_ms.p99:.1f}), {arms.bad_packets} answers asked for again"
    )


def _verdict(controller: LoadedController, summary: Summary | None, failure: str) -> Text:
    if failure:
        return Text(failure, style="red")
    if summary is None:
        return Text("no trajectory was tracked", style="red")
    if not (summary.landed and summary.disarmed):
        return Text("the vehicle did not land and disarm", style="red")
    if not within_limits(summary, controller.error_limits):
        return Text("landed and disarmed, but outside the error limits", style="red")
    return Text("landed, disarmed, inside the error limits", style="green")
