"""Output of the fault flights, printed and kept: a line each, faults.json and docs/safety.md."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from companion.supervisor.faults import TABLE
from tests.flights.command import ROOT
from tests.flights.faults.judge import Result
from tests.flights.faults.rows import RULES
from tests.flights.faults.rows import Row as Flown
from tests.flights.faults.schedules import Outcome

PAGE = ROOT / "docs" / "safety.md"
RECOGNISED, FLOWN = "recognised", "flown"
"""The parts of the page that are printed, between comments with these words."""


def line_of(one: Result | Outcome) -> str:
    """Return a flight's outcome as one line."""
    name, reaction = (one.name, _seconds(one.reaction_s)) if isinstance(one, Result) else (_schedule(one), "")
    problems = f"  NOT AS IT MUST BE: {'; '.join(one.problems)}" if one.problems else ""
    return f"{name}: {one.end_state}{reaction and f', reaction after {reaction} s'}{problems}"


def _schedule(outcome: Outcome) -> str:
    return f"seed {outcome.seed}, {'; '.join(outcome.faults)}"


def write_json(results: Mapping[str, Result], path: Path) -> None:
    """Write what every flight came to."""
    path.write_text(json.dumps([asdict(result) for result in results.values()], indent=1) + "\n", encoding="utf-8")


def read_json(path: Path) -> dict[str, Result]:
    """Return those flights by name, less those that were not as they must be; none without a file."""
    lines = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    return {line["name"]: Result(**line | {"problems": ()}) for line in lines if not line["problems"]}


def recognised() -> str:
    """faults.TABLE as Markdown, with the limits' values."""
    lines = [
        "| fault | how it is recognised | why | flying | landing | on the ground | handed over | needs a pose |",
        "|" + " --- |" * 8,
    ]
    lines += [
        f"| {row.fault} | {row.sign.format(**asdict(RULES))} | {row.why} | {row.flying.words} | {row.landing.words} | "
        f"{row.ground.words} | {row.handed_over.words} | {'' if row.needs is None else 'yes'} |"
        for row in TABLE
    ]
    return "\n".join(lines)


def flown(rows: Sequence[Flown], results: Mapping[str, Result]) -> str:
    """Return what was flown as a Markdown table; a row that has no result has nothing measured."""
    lines = [
        "| fault | what goes wrong | when | reaction | ends | limit s | measured s | drift m |",
        "|" + " --- |" * 8,
    ]
    for row in rows:
        result = results.get(row.name)
        measured = [_seconds(result.reaction_s), _metres(result.drift_m)] if result else ["", ""]
        limit, reaction = ("", "none") if row.harmless else (_seconds(row.limit_s), row.reaction.words)
        cells = [row.fault, row.variant, row.when, reaction, row.ends, limit, *measured]
        lines.append(f"| {' | '.join(cells)} |")
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


def _metres(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"
