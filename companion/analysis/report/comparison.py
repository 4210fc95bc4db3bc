"""Several flights in one table. Pure."""

from collections.abc import Sequence

from companion.analysis.report.number_tables import NOTHING, error_cells, letters, ms, share_cells
from companion.analysis.report.numbers import Numbers
from companion.analysis.report.tables import BAD, PLAIN, Cell, Grid


def comparison(flights: Sequence[Numbers]) -> Grid:
    """A row for each trajectory of each flight; for a flight without one, over all in the air."""
    columns = (
        "", "law", "over", "mean x", "y", "z", "norm", "max x", "y", "z", "norm", "triggers", "updates", "to setpoint",
        "faults",
    )  # fmt: skip
    rows = tuple(
        row for letter, one in zip(letters(len(flights)), flights, strict=True) for row in _compared(letter, one)
    )
    note = (
        "Errors in cm, over each trajectory, or over all in the air where none was flown; triggers, and updates "
        "(setpoints sent), as shares of the same cycles; from the frame's arrival to the setpoint 95 % within so many "
        "ms, and faults, of the whole flight."
    )
    return Grid("Beside each other", columns, rows, note)


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
