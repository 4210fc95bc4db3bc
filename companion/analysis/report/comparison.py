"""Several flights in one table. Pure."""

from collections.abc import Sequence

from companion.analysis.report.number_tables import NOTHING, error_cells, letters, ms, share_cells
from companion.analysis.report.numbers import Numbers
from companion.analysis.report.tables import BAD, PLAIN, Cell, Grid


def comparison(flights: Sequence[Numbers]) -> Grid:
    """Return a row for each trajectory of each flight, and for each flight without one."""
    columns = (
        "", "law", "over", "mean x", "y", "z", "norm", "max x", "y", "z", "norm", "triggers", "updates", "latency",
        "faults",
    )  # fmt: skip
    rows = tuple(
        row for letter, one in zip(letters(len(flights)), flights, strict=True) for row in _compared(letter, one)
    )
    note = (
        "Errors in cm on each trajectory, or in the air without one; triggers, and updates (setpoints sent), as shares "
        "of the same cycles. Of the whole flight: 95 % of the times from a frame's arrival to its setpoint, ms; "
        "number of faults."
    )
    return Grid("Comparison", columns, rows, note)


def _compared(letter: str, one: Numbers) -> list[tuple[Cell, ...]]:
    from_frame = one.latencies.get("frame to setpoint")
    flight = (
        Cell(NOTHING) if from_frame is None else ms(from_frame.p95_s),
        Cell(str(len(one.story.faults)), BAD if one.story.reactions else PLAIN),
    )
    if not one.trajectories:
        law = Cell(", ".join(one.laws) or NOTHING)
        return [(Cell(letter), law, Cell("flight"), *error_cells(one.whole), *share_cells(one.triggers_whole), *flight)]
    return [
        (
            Cell(f"{letter}{number}" if len(one.trajectories) > 1 else letter), Cell(flown.law or NOTHING),
            Cell(flown.name), *error_cells(flown.errors), *share_cells(flown.triggers), *flight,
        )
        for number, flown in enumerate(one.trajectories, 1)
    ]  # fmt: skip
