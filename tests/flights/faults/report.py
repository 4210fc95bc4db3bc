"""Output of the fault flights, printed and kept: a table, faults.json and docs/safety.md."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from companion.supervisor.faults import TABLE
from tests.flights.command import ROOT
from tests.flights.faults.judge import Result
from tests.flights.faults.rows import RULES
from tests.flights.faults.rows import Row as Flown

PAGE = ROOT / "docs" / "safety.md"
RECOGNISED, FLOWN = "recognised", "flown"
"""The parts of the page that are printed, between comments with these words."""


def table_of(results: Sequence[Result]) -> Table:
    """For the screen."""
    table = Table(title="Fault flights")
    for column in ("fault", "end", "reaction s", "limit s", "inside", ""):
        table.add_column(column)
    for result in results:
        table.add_row(
            result.name, result.end_state, _seconds(result.reaction_s), _seconds(result.limit_s or None),
            "yes" if result.inside_fence else "NO", "; ".join(result.problems), style="red" if result.problems else "",
        )  # fmt: skip
    return table


def write_json(results: Sequence[Result], path: Path) -> None:
    """A list of what every flight came to."""
    lines = [
        {
            "fault": result.name,
            "end_state": result.end_state,
            "reaction_s": result.reaction_s,
            "limit_s": result.limit_s or None,
            "inside_fence": result.inside_fence,
        }
        for result in results
    ]
    path.write_text(json.dumps(lines, indent=1) + "\n", encoding="utf-8")


def recognised() -> str:
    """faults.TABLE as Markdown, with the limits' values."""
    lines = [
        "| fault | how it is recognised | why | flying | landing | on the ground | handed over |",
        "|" + " --- |" * 7,
    ]
    lines += [
        f"| {row.fault} | {row.sign.format(**asdict(RULES))} | {row.why} | {row.flying.words} | {row.landing.words} | "
        f"{row.ground.words} | {row.handed_over.words} |"
        for row in TABLE
    ]
    return "\n".join(lines)


def flown(rows: Sequence[Flown], results: Sequence[Result]) -> str:
    """Return what was flown as a Markdown table; a row that has no result has no measured reaction."""
    by_name = {result.name: result for result in results}
    lines = ["| fault | what goes wrong | when | reaction | ends | limit s | measured s |", "|" + " --- |" * 7]
    for row in rows:
        result = by_name.get(row.name)
        measured = _seconds(result.reaction_s) if result else ""
        lines.append(
            f"| {row.fault} | {row.variant} | {row.when} | {'none' if row.harmless else row.reaction.words} | "
            f"{row.ends} | {'' if row.harmless else _seconds(row.limit_s)} | {measured} |"
        )
    return "\n".join(lines)


def part(text: str, name: str) -> str:
    """Return the text between the marks of a printed part."""
    begin, end = _marks(name)
    return text[text.index(begin) + len(begin) : text.index(end)].strip()


def write_page(parts: dict[str, str], path: Path = PAGE) -> None:
    """Print the parts anew; the words around them stay."""
    text = path.read_text(encoding="utf-8")
    for name, table in parts.items():
        begin, end = _marks(name)
        before, after = text[: text.index(begin)], text[text.index(end) :]
        text = f"{before}{begin}\n\n{table}\n\n{after}"
    path.write_text(text, encoding="utf-8")


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- {name}: printed by make faults -->", f"<!-- end of {name} -->"


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
