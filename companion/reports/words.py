"""A flight's numbers in words: facts of the head, and tables. Pure."""

from collections.abc import Sequence
from datetime import UTC, datetime

from companion.reports.numbers import AXES, Errors, Numbers, Triggers
from companion.reports.tables import BAD, PLAIN, WORDS, Cell, Grid

_NOTHING = "–"


def head(numbers: Numbers) -> list[tuple[str, str]]:
    """What flight this is."""
    facts = [("when", _when(numbers.started_unix_s))] if numbers.started_unix_s is not None else []
    if numbers.vehicle:
        facts.append(("vehicle", numbers.vehicle))
    facts += [
        ("in the air", f"{numbers.duration_s:.1f} s" if numbers.duration_s else "never"),
        ("law", laws(numbers)),
        ("ended", numbers.ended),
        ("record", _state(numbers)),
    ]
    if numbers.versions:
        facts.append(("versions", ", ".join(f"{name} {version}" for name, version in numbers.versions.items())))
    return facts


def _when(unix_s: float) -> str:
    """Of this computer's time zone."""
    return f"{datetime.fromtimestamp(unix_s, UTC).astimezone():%Y-%m-%d %H:%M:%S %Z}"


def laws(numbers: Numbers) -> str:
    """One after the other, with when each began where there were several."""
    stretches = numbers.story.laws
    if len(stretches) < 2:
        return ", ".join(numbers.laws) or "none flew"
    return ", then ".join(f"{one.name} from {max(one.begin_s, 0.0):.1f} s" for one in stretches)


def _state(numbers: Numbers) -> str:
    """Whether all of the flight is there, in one line."""
    says = []
    if numbers.truncated:
        says.append("cut off: the file ends in the middle; what came after its last cycle is not known")
    elif not numbers.over:
        says.append("breaks off in flight: the service was killed, or the disk was full; what came after is not known")
    if numbers.dropped:
        says.append(f"{numbers.dropped} cycles are missing")
    return "; ".join(says) or "complete"


def error_table(numbers: Numbers) -> Grid | None:
    """Mean, rms and largest error; None when there is none."""
    rows: list[tuple[Cell, ...]] = []
    for name, errors in (("on the trajectory", numbers.tracked), ("in the air", numbers.whole)):
        if errors is not None:
            rows += _error_rows(name, errors)
    if not rows:
        return None
    note = "Absolute errors in cm, world frame: estimated position at the instant of the cycle less the reference."
    return Grid("Errors (cm)", ("", "", *AXES, "norm"), tuple(rows), note)


def _error_rows(name: str, errors: Errors) -> list[tuple[Cell, ...]]:
    kinds = (("mean", errors.mean_m), ("rms", errors.rms_m), ("max", errors.max_m))
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
    """How often something was sent."""
    found = [
        (name, triggers)
        for name, triggers in (("on the trajectory", numbers.triggers_tracked), ("in the air", numbers.triggers_whole))
        if triggers is not None
    ]
    if not found:
        return None
    columns = ("", "cycles", "triggers", "share", "setpoints sent", "median gap (ms)", "longest gap (ms)")
    rows = tuple(
        (
            Cell(name), Cell(str(one.cycles)), Cell(str(one.events)), Cell(f"{one.event_share:.1%}"),
            Cell(f"{one.sent_share:.1%}"), _ms(one.gap_median_s), _ms(one.gap_max_s),
        )
        for name, one in found
    )  # fmt: skip
    note = "More setpoints than triggers: the gate goes on towards the wanted one as fast as it may."
    return Grid("Triggers", columns, rows, note)


def _ms(value_s: float) -> Cell:
    return Cell(f"{1e3 * value_s:.1f}" if value_s == value_s else _NOTHING)  # noqa: PLR0124 - NaN


def latency_table(numbers: Numbers) -> Grid | None:
    """Median, 95 % and largest."""
    if not numbers.latencies:
        return None
    rows = tuple(
        (Cell(name), Cell(str(one.count)), _ms(one.median_s), _ms(one.p95_s), _ms(one.max_s))
        for name, one in numbers.latencies.items()
    )
    return Grid("Latencies in the air (ms)", ("", "cycles", "median", "95 %", "max"), rows)


def fault_table(numbers: Numbers) -> Grid:
    """Each fault from begin to end."""
    faults = numbers.story.faults
    if not faults:
        rows: tuple[tuple[Cell, ...], ...] = ((Cell("none"), Cell(""), Cell(""), Cell("", WORDS)),)
    else:
        rows = tuple(
            (Cell(one.fault), Cell(_from_to(one.begin_s, one.end_s)), Cell(one.reaction), Cell(one.text, WORDS))
            for one in faults[:_MOST_ROWS]
        )
    left = len(faults) - _MOST_ROWS
    note = f"and {left} more, in the numbers that --json prints" if left > 0 else ""
    return Grid("Faults", ("", "s since lift-off", "reaction", "what was wrong"), rows, note)


_MOST_ROWS = 60


def _from_to(begin_s: float, end_s: float | None) -> str:
    return f"{begin_s:.2f} to {'the end' if end_s is None else f'{end_s:.2f}'}"


def reaction_table(numbers: Numbers) -> Grid | None:
    """What was done about them."""
    if not numbers.story.reactions:
        return None
    rows = tuple(
        (Cell(one.reaction, BAD), Cell(f"{one.at_s:.2f}"), Cell(one.cause or _NOTHING), Cell(one.reason, WORDS))
        for one in numbers.story.reactions
    )
    return Grid("Reactions", ("", "s since lift-off", "because of", "why"), rows)


def said_table(numbers: Numbers) -> Grid | None:
    """Commands and replies."""
    if not numbers.story.said:
        return None
    rows = tuple(
        (Cell(one.kind), Cell(f"{one.at_s:.2f}"), Cell(one.text, WORDS)) for one in numbers.story.said[:_MOST_ROWS]
    )
    return Grid("Commands and replies", ("", "s since lift-off", ""), rows)


def comparison(flights: Sequence[Numbers]) -> Grid:
    """A row a flight."""
    columns = (
        "", "law", "over", "mean x", "y", "z", "norm", "max x", "y", "z", "norm", "triggers", "sent", "to setpoint",
        "faults",
    )  # fmt: skip
    rows = tuple(_compared(letter, one) for letter, one in zip(letters(len(flights)), flights, strict=True))
    note = (
        "Errors in cm, over the cycles that flew a trajectory, or over all in the air where none did; triggers and "
        "setpoints as shares of the same cycles; from the frame's arrival to the setpoint 95 % within so many ms."
    )
    return Grid("Beside each other", columns, rows, note)


def letters(count: int) -> list[str]:
    """A, B, C, ..., AA: short names of flights."""
    names = [chr(ord("A") + number) for number in range(26)]
    return (names + [first + second for first in names for second in names])[:count]


def _compared(letter: str, one: Numbers) -> tuple[Cell, ...]:
    on_trajectory = one.tracked is not None
    errors, triggers = (one.tracked, one.triggers_tracked) if on_trajectory else (one.whole, one.triggers_whole)
    from_frame = one.latencies.get("frame to setpoint")
    return (
        Cell(letter),
        Cell(", ".join(one.laws) or _NOTHING),
        Cell("trajectory" if on_trajectory else "flight"),
        *_error_cells(errors),
        *_share_cells(triggers),
        Cell(_NOTHING) if from_frame is None else _ms(from_frame.p95_s),
        Cell(str(len(one.story.faults)), BAD if one.story.reactions else PLAIN),
    )


def _error_cells(errors: Errors | None) -> list[Cell]:
    if errors is None:
        return [Cell(_NOTHING)] * 8
    return [_cm(value) for value in (*errors.mean_m, *errors.max_m)]


def _share_cells(triggers: Triggers | None) -> list[Cell]:
    if triggers is None:
        return [Cell(_NOTHING)] * 2
    return [Cell(f"{triggers.event_share:.0%}"), Cell(f"{triggers.sent_share:.0%}")]
