"""Numbers of a flight: tables for people, JSON for programs."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console, Group
from rich.text import Text

from companion.analysis.summary import ArmSummary, LinkSummary, Spread, Summary
from companion.cli.terminal import numbers_table
from companion.config.controller_config import ErrorLimits, LoadedController
from companion.core.types import Array

ErrorRow = tuple[str, Sequence[float] | Array, float | None]
"""Name, errors of x, y and z (m), and their limit (m), if any."""


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
        "frame_to_setpoint_ms": _as_dict(summary.frame_to_setpoint_ms),
        "capture_to_setpoint_ms": _as_dict(summary.capture_to_setpoint_ms),
        "landed": summary.landed,
        "disarmed": summary.disarmed,
        "arms": None if summary.arms is None else asdict(summary.arms),
        **({} if summary.link is None else {"link": asdict(summary.link)}),
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
        if summary.link is not None:
            console.print(_link_line(summary.link), highlight=False, soft_wrap=True)
    verdict = Text.assemble(("interrupted", "yellow"), "; ") if interrupted else Text()
    console.print(verdict + _verdict(controller, summary, failure), highlight=False, soft_wrap=True)


def print_comparison(console: Console, flights: list[tuple[str, Summary | None]]) -> None:
    """Print a table of several controllers on one trajectory, with the first one's reduction against the last."""
    rows: list[tuple[str, ...]] = []
    for name, summary in flights:
        if summary is not None:
            errors = [f"{100.0 * value:.2f}" for value in (*summary.mean_error_m, *summary.max_error_m)]
            rows.append((name, *errors, f"{summary.update_share:.1%}"))
    (_, first), (_, last) = flights[0], flights[-1]
    if first is not None and last is not None:
        pairs = zip((*first.mean_error_m, *first.max_error_m), (*last.mean_error_m, *last.max_error_m), strict=True)
        rows.append(("reduced by", *(f"{1.0 - mine / other:.0%}" for mine, other in pairs), ""))
    columns = ("controller", "mean x", "y", "z", "max x", "y", "z", "updates")
    console.print(numbers_table("comparison, errors in cm", columns, rows))


def _error_table(controller: LoadedController, summary: Summary) -> Group:
    limits = controller.error_limits
    return error_table(
        f"tracking error, {controller.name}",
        [
            ("mean", summary.mean_error_m, limits.mean_m),
            ("RMS", summary.rms_error_m, None),
            ("max", summary.max_error_m, limits.max_m),
        ],
    )


def error_table(title: str, rows: Iterable[ErrorRow]) -> Group:
    """Return a table of errors in cm, red where they exceed their limit."""
    cells: list[list[str | Text]] = []
    for name, errors_m, limit_m in rows:
        styles = ["red" if limit_m is not None and error_m > limit_m else "" for error_m in errors_m]
        errors = [Text(f"{100.0 * one:.2f}", style=style) for one, style in zip(errors_m, styles, strict=True)]
        cells.append([name, *errors, "" if limit_m is None else f"{100.0 * limit_m:g}"])
    return numbers_table(title, ("cm", "x", "y", "z", "limit"), cells)


def _as_dict(spread: Spread | None) -> dict[str, float] | None:
    return None if spread is None else spread.as_dict()


def _timing_table(summary: Summary) -> Group:
    spreads = (
        ("tick late", summary.tick_late_ms),
        ("frame arrival to setpoint", summary.frame_to_setpoint_ms),
        ("frame capture to setpoint", summary.capture_to_setpoint_ms),
    )
    return numbers_table(
        f"updates in {summary.update_share:.1%} of {summary.control_cycles} cycles",
        ("timing (ms)", "median", "p99"),
        [(name, f"{spread.median:.2f}", f"{spread.p99:.2f}") for name, spread in spreads if spread is not None],
    )


def _arms_line(arms: ArmSummary) -> str:
    did = "moving" if arms.moving_share > 0.0 else "still"
    off_deg = math.degrees(arms.largest_off_goal_rad)
    return (
        f"arms {did}, joints within {off_deg:.1f}° of their goals; bus cycle {arms.bus_cycle_ms.median:.1f} ms "
        f"(p99 {arms.bus_cycle_ms.p99:.1f}), {arms.bad_packets} answers asked for again"
    )


def _link_line(link: LinkSummary) -> str:
    return (
        f"link {link.messages_per_s:.0f} messages/s, {link.uplink_bytes_per_s:.0f} bytes/s up: {link.events} events, "
        f"{link.beats} beats, {link.again} again, {link.lost} lost; age {link.age_ms.median:.1f} ms (p99 "
        f"{link.age_ms.p99:.1f}), longest silence {link.longest_silence_ms:.0f} ms"
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
