"""Report of one or several flights as one self-contained page."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape
from io import BytesIO
from itertools import groupby

from companion import __version__
from companion.analysis.report import number_tables
from companion.analysis.report.charts import Chart, Medium, shades_of
from companion.analysis.report.compare import overlaid
from companion.analysis.report.comparison import comparison
from companion.analysis.report.figures import charts_of
from companion.analysis.report.html import contents, facts, lead, picture, swatches, table, tables, whole
from companion.analysis.report.link_table import link_table
from companion.analysis.report.number_tables import letters
from companion.analysis.report.numbers import Numbers, numbers_of
from companion.analysis.report.recorded_flight import Flown
from companion.analysis.report.separation import separation_table
from companion.analysis.report.summary import summary, verdict
from companion.analysis.report.tables import WORDS, Cell, Grid
from companion.analysis.report.trajectories import law_label

Progress = Callable[[str], None]
"""Function that is called with the name of each figure before it is drawn."""

_TITLES = ("Numbers", "Events", "Figures")


@dataclass(frozen=True)
class Chapter:
    """One flight of a report."""

    flown: Flown
    numbers: Numbers
    charts: Sequence[Chart]


def chapter_of(flown: Flown) -> Chapter:
    """Return the chapter of a flight without drawing its figures."""
    numbers = numbers_of(flown)
    return Chapter(flown, numbers, charts_of(flown, numbers.story))


def page(chapters: Sequence[Chapter], progress: Progress) -> str:
    """Return the HTML; drawing takes some seconds for each flight."""
    if len(chapters) == 1:
        (only,) = chapters
        return whole(escape(f"Flight {only.flown.name}"), _chapter(only, "", progress) + _made())
    lettered = list(zip(letters(len(chapters)), chapters, strict=True))
    verdicts = [(f"{letter}: {one.flown.name}", verdict(one.numbers)) for letter, one in lettered]
    body = [
        contents([(letter, f"{letter}: {one.flown.name}") for letter, one in lettered]),
        table(
            Grid("Verdicts", ("flight", ""), tuple((Cell(name), replace(cell, tone=WORDS)) for name, cell in verdicts))
        ),
        table(comparison([chapter.numbers for chapter in chapters])),
        *(_drawn(chart, progress) for chart in overlaid([chapter.flown for chapter in chapters])),
        *(
            f'<section id="{letter}">\n<h2>{letter}: {escape(one.flown.name)}</h2>\n{_chapter(one, letter, progress)}\n'
            "</section>"
            for letter, one in lettered
        ),
    ]
    return whole(f"{len(chapters)} flights", "\n".join(body) + _made())


def _made() -> str:
    return f"<p class=note>Drawn by dauam-companion {escape(__version__)}. Times are seconds since lift-off.</p>"


def _chapter(chapter: Chapter, letter: str, progress: Progress) -> str:
    """Return verdict, contents, numbers, figures and settings of a flight; `letter` makes its anchors unique."""
    numbers = chapter.numbers
    first, *rest = chapter.charts
    grids: list[Grid | None] = [
        number_tables.trajectory_table(numbers), number_tables.error_table(numbers),
        number_tables.trigger_table(numbers), number_tables.latency_table(numbers),
        link_table(numbers.link), separation_table(numbers.others), number_tables.horizon_table(numbers),
    ]  # fmt: skip
    happened: list[Grid | None] = [
        number_tables.fault_table(numbers), number_tables.reaction_table(numbers), number_tables.said_table(numbers),
    ]  # fmt: skip
    return "\n".join(
        [
            lead(verdict(numbers), summary(numbers)),
            contents([(f"{letter}{title}", title) for title in _TITLES[: None if rest else 2]]),
            facts(number_tables.head(numbers)),
            _heading(letter, "Numbers"),
            tables(grid for grid in grids if grid is not None),
            _heading(letter, "Events"),
            _drawn(first, progress),
            swatches(shades_of(chapter.flown)),
            tables(grid for grid in happened if grid is not None),
            _heading(letter, "Figures") if rest else "",
            _figures(rest, progress),
            _settings(chapter.flown),
        ]
    )


def _heading(letter: str, title: str) -> str:
    return f'<h3 id="{letter}{title}">{title}</h3>'


def _figures(charts: Sequence[Chart], progress: Progress) -> str:
    """Return wide figures below each other, and narrow ones in pairs."""
    parts = []
    for wide, group in groupby(_paired(charts), key=lambda chart: chart.wide):
        drawn = "\n".join(_drawn(chart, progress) for chart in group)
        parts.append(drawn if wide else f'<div class="pair">\n{drawn}\n</div>')
    return "\n".join(parts)


def _paired(charts: Sequence[Chart]) -> list[Chart]:
    """Return the charts in order, with each narrow one directly followed by the next narrow one."""
    left, order = list(charts), []
    while left:
        chart = left.pop(0)
        order.append(chart)
        if not chart.wide:
            other = next((one for one in left if not one.wide), None)
            if other is not None:
                left.remove(other)
                order.append(other)
    return order


def _drawn(chart: Chart, progress: Progress) -> str:
    progress(chart.name)
    into = BytesIO()
    chart.save(into, Medium.PAGE)
    return picture(chart.name, chart.caption, into.getvalue(), wide=chart.wide)


def _settings(flown: Flown) -> str:
    """Return the configuration and every law's file at the time of the flight, folded."""
    metadata = flown.record.metadata
    parts = []
    if metadata.get("config"):
        text = json.dumps(metadata["config"], indent=2)
        parts.append(f"<details><summary>Configuration</summary>\n<pre>{escape(text)}</pre></details>")
    controller = metadata.get("controller") or {}
    ground = flown.record.ground
    laws = dict(metadata.get("laws") or {}) | dict((ground.metadata.get("laws") if ground else None) or {})
    if controller.get("file"):
        laws.setdefault(str(controller.get("name", "law")), controller["file"])
    for name, text in laws.items():
        parts.append(
            f"<details><summary>Law {escape(law_label(str(name)))}</summary>\n<pre>{escape(str(text))}</pre></details>"
        )
    return "\n".join(parts)
