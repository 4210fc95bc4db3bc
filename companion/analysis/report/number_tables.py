"""Numbers of a flight as text: the facts on top, and tables. Pure."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from companion.analysis.report.numbers import AXES, Errors, Numbers, TrajectoryNumbers, Triggers
from companion.analysis.report.recorded_flight import GROUND_TO_SETPOINT
from companion.analysis.report.tables import BAD, WORDS, Cell, Grid
from companion.analysis.report.trajectories import UNNAMED

NOTHING = "–"
_ALSO_S = 1.0
"""Largest difference of the law's time in the air and the vehicle's that is not worth a word."""


def head(numbers: Numbers) -> list[tuple[str, str]]:
    """Return the facts on top of a report: date, vehicle, duration, law, record, versions."""
    facts = [("when", _when(numbers.started_unix_s))] if numbers.started_unix_s is not None else []
    if numbers.vehicle:
        facts.append(("vehicle", numbers.vehicle))
    facts += [
        ("in the air", in_the_air(numbers)),
        ("law", laws(numbers)),
        *([("side of the link", numbers.side)] if numbers.side else []),
        ("record", _state(numbers)),
    ]
    if numbers.versions:
        facts.append(("versions", ", ".join(f"{name} {version}" for name, version in numbers.versions.items())))
    if numbers.off:
        facts.append(("off", numbers.off.removeprefix("off: ")))
    return facts


def in_the_air(numbers: Numbers) -> str:
    """Return the time in the air, and the law's share of it when the autopilot flew the rest."""
    if not numbers.duration_s:
        return "never"
    text = f"{numbers.duration_s:.1f} s"
    if numbers.duration_s - numbers.law_s > _ALSO_S:
        text += f", {numbers.law_s:.1f} s of them by our law"
    return text


def _when(unix_s: float) -> str:
    """Return date and time in this computer's time zone."""
    return f"{datetime.fromtimestamp(unix_s, UTC).astimezone():%Y-%m-%d %H:%M:%S %Z}"


def laws(numbers: Numbers) -> str:
    """Return the laws in order, with the start of each if there are several."""
    stretches = numbers.story.laws
    if len(stretches) < 2:
        return ", ".join(numbers.laws) or "none flew"
    return ", then ".join(f"{one.name} from {max(one.begin_s, 0.0):.1f} s" for one in stretches)


def _state(numbers: Numbers) -> str:
    """Return one line on whether the record is complete."""
    says = []
    if numbers.damage:
        says.append(f"damaged: {numbers.damage}; shown is what can be read")
    if numbers.truncated:
        says.append("cut off: the file ends in the middle; what came after its last cycle is not known")
    elif not numbers.over:
        says.append("breaks off in flight: the service was killed, or the disk was full; what came after is not known")
    if numbers.dropped:
        says.append(f"{numbers.dropped} cycles are missing")
    return "; ".join(says) or "complete"


def error_table(numbers: Numbers) -> Grid | None:
    """Return mean, RMS and largest error of each trajectory and of the whole flight; None without errors."""
    rows: list[tuple[Cell, ...]] = []
    for name, errors in [*_named(numbers, "errors"), ("in the air", numbers.whole)]:
        if errors is not None:
            rows += _error_rows(name, errors)
    if not rows:
        return None
    note = "Absolute errors in cm, world frame: estimated position at the time of the cycle minus the reference."
    return Grid("Errors (cm)", ("", "", *AXES, "norm"), tuple(rows), note)


def _named(numbers: Numbers, what: str) -> list[tuple[str, Any]]:
    """Return the errors or triggers of each trajectory with its name."""
    names = trajectory_names(numbers.trajectories)
    return [(name, getattr(one, what)) for name, one in zip(names, numbers.trajectories, strict=True)]


def trajectory_names(trajectories: Sequence[TrajectoryNumbers]) -> list[str]:
    """Return the name of each in tables: numbered, and with its law, if there are several."""
    if len(trajectories) == 1:
        (only,) = trajectories
        return ["on the trajectory" if only.name == UNNAMED else f"on the trajectory, {only.name}"]
    return [f"{number}: {one.name}, {one.law}" for number, one in enumerate(trajectories, 1)]


def trajectory_table(numbers: Numbers) -> Grid | None:
    """Return a row for each trajectory; None when there are fewer than two."""
    if len(numbers.trajectories) < 2:
        return None
    columns = (
        "", "law", "from (s)", "for (s)", "mean x", "y", "z", "norm", "max x", "y", "z", "norm", "triggers", "updates",
        "longest gap (ms)",
    )  # fmt: skip
    rows = tuple(
        (
            Cell(f"{number}: {one.name}"), Cell(one.law), Cell(f"{one.begin_s:.1f}"), Cell(f"{one.duration_s:.1f}"),
            *error_cells(one.errors), *share_cells(one.triggers),
            Cell(NOTHING) if one.triggers is None else ms(one.triggers.gap_max_s),
        )
        for number, one in enumerate(numbers.trajectories, 1)
    )  # fmt: skip
    note = (
        "Errors in cm; triggers, and updates (setpoints sent), as shares of the trajectory's cycles; longest time "
        "between two triggers within the trajectory."
    )
    return Grid("Trajectories", columns, rows, note)


def _error_rows(name: str, errors: Errors) -> list[tuple[Cell, ...]]:
    kinds = (("mean", errors.mean_m), ("RMS", errors.rms_m), ("max", errors.max_m))
    return [
        (
            Cell(f"{name}, {errors.cycles} cycles" if kind == "mean" else ""),
            Cell(kind),
            *(_cm(value) for value in values),
        )
        for kind, values in kinds
    ]


def _cm(value_m: float) -> Cell:
    return Cell(f"{100.0 * value_m:.2f}")


def trigger_table(numbers: Numbers) -> Grid | None:
    """Return the table of triggers and updates."""
    all_of_it = [*_named(numbers, "triggers"), ("in the air", numbers.triggers_whole)]
    found: list[tuple[str, Triggers]] = [(name, triggers) for name, triggers in all_of_it if triggers is not None]
    if not found:
        return None
    columns = ("", "cycles", "triggers", "share", "updates", "median gap (ms)", "longest gap (ms)")
    rows = tuple(
        (
            Cell(name), Cell(str(one.cycles)), Cell(str(one.events)), Cell(f"{one.event_share:.1%}"),
            Cell(f"{one.sent_share:.1%}"), ms(one.gap_median_s), ms(one.gap_max_s),
        )
        for name, one in found
    )  # fmt: skip
    note = (
        "Gap: time between two triggers of the same trajectory or flight. Updates: share of cycles that sent a "
        "setpoint. After a trigger the rate limits may need more than one update to reach the commanded setpoint."
    )
    return Grid("Triggers", columns, rows, note)


def ms(value_s: float) -> Cell:
    """Return a time in ms; a dash for NaN."""
    return Cell(f"{1e3 * value_s:.1f}" if value_s == value_s else NOTHING)  # noqa: PLR0124 - NaN


def latency_table(numbers: Numbers) -> Grid | None:
    """Return the table of latencies: median, 95 % and largest."""
    if not numbers.latencies:
        return None
    rows = tuple(
        (Cell(name), Cell(str(one.count)), ms(one.median_s), ms(one.p95_s), ms(one.max_s))
        for name, one in numbers.latencies.items()
    )
    note = _LATENCIES + (_OVER_GROUND if GROUND_TO_SETPOINT in numbers.latencies else "")
    return Grid("Latencies in the air (ms)", ("", "cycles", "median", "95 %", "max"), rows, note)


_LATENCIES = (
    "Age of the pose used: from its capture to the start of the cycle that uses it. Cycle late: from the frame or "
    "deadline that starts a cycle to its start. Frame to setpoint: from the frame's arrival at this computer to the "
    "sending of the setpoint. Capture to setpoint: from the cameras' exposure to the sending."
)
_OVER_GROUND = (
    " Ground's capture to setpoint: the same for the frame that a law on the ground has computed its command from, in "
    "the cycles that were the first to use a command."
)


def horizon_table(numbers: Numbers) -> Grid | None:
    """Return the table of the horizon's difference and its correction."""
    one = numbers.horizon
    if one is None:
        return None
    cells = [Cell(f"{math.degrees(angle):.2f}") for angle in (one.rms_rad, one.max_rad, one.corrected_rms_rad)]
    row = (Cell("roll and pitch together"), *cells)
    return Grid("The autopilot's horizon (degrees)", ("", "RMS", "max", "corrected, RMS"), (row,), _HORIZON)


_HORIZON = (
    "Slow difference between the autopilot's horizon and motion capture's while the law flew, and the part of it that "
    "was corrected: docs/horizon.md."
)


def fault_table(numbers: Numbers) -> Grid:
    """Return each fault from begin to end; no rows when there was none."""
    faults = numbers.story.faults
    rows = tuple(
        (Cell(one.fault), Cell(_from_to(one.begin_s, one.end_s)), Cell(one.reaction), Cell(one.text, WORDS))
        for one in faults[:_MOST_ROWS]
    )
    left = len(faults) - _MOST_ROWS
    note = f"and {left} more, in the output of --json" if left > 0 else "" if faults else "none"
    return Grid("Faults", ("", "since lift-off (s)", "action", "message"), rows, note)


_MOST_ROWS = 60


def _from_to(begin_s: float, end_s: float | None) -> str:
    return f"{begin_s:.2f} to {'the end' if end_s is None else f'{end_s:.2f}'}"


def reaction_table(numbers: Numbers) -> Grid | None:
    """Return the table of failsafe actions; None without any."""
    if not numbers.story.reactions:
        return None
    rows = tuple(
        (Cell(one.reaction, BAD), Cell(f"{one.at_s:.2f}"), Cell(one.cause or NOTHING), Cell(one.reason, WORDS))
        for one in numbers.story.reactions
    )
    return Grid("Failsafe actions", ("", "since lift-off (s)", "fault", "reason"), rows)


def said_table(numbers: Numbers) -> Grid | None:
    """Return the table of commands and replies; None without any."""
    if not numbers.story.said:
        return None
    rows = tuple(
        (Cell(one.kind), Cell(f"{one.at_s:.2f}"), Cell(one.text, WORDS)) for one in numbers.story.said[:_MOST_ROWS]
    )
    return Grid("Commands and replies", ("", "since lift-off (s)", ""), rows)


def letters(count: int) -> list[str]:
    """Return short names of flights: A, B, C, ..., AA."""
    names = [chr(ord("A") + number) for number in range(26)]
    return (names + [first + second for first in names for second in names])[:count]


def error_cells(errors: Errors | None) -> list[Cell]:
    """Return mean and largest errors, cm: x, y, z and the norm of each."""
    if errors is None:
        return [Cell(NOTHING)] * 8
    return [_cm(value) for value in (*errors.mean_m, *errors.max_m)]


def share_cells(triggers: Triggers | None) -> list[Cell]:
    """Return the shares of cycles with a trigger, and with a setpoint sent."""
    if triggers is None:
        return [Cell(NOTHING)] * 2
    return [Cell(f"{triggers.event_share:.0%}"), Cell(f"{triggers.sent_share:.0%}")]
