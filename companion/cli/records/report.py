"""`companion report`: a page of flights, figures for a paper, numbers as JSON."""

import json
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from companion.cli.output import check_file, check_folder_of, check_output, kept
from companion.core.errors import ConfigError

if TYPE_CHECKING:
    from companion.analysis.report.page import Chapter

_MOST = 26


class Format(StrEnum):
    """File format of a figure."""

    PDF = "pdf"
    PNG = "png"


def report(
    flights: Annotated[list[Path], typer.Argument(metavar="FLIGHT...", help="Records, MCAP or NPZ files.")],
    out: Annotated[
        Path | None, typer.Option(help="Write the page here.  [default: FLIGHT.html beside the first flight]")
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Write each figure into this folder, sized for a paper's column.")
    ] = None,
    file_format: Annotated[Format, typer.Option("--format", help="Format of the files of --figures.")] = Format.PDF,
    as_json: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON.")] = False,
) -> None:
    """Make a page of one or several recorded flights: errors, figures, triggers, latencies, faults and reactions.

    The page is one self-contained HTML file; records that were cut off work, too. Exit code 2 for a file that is no
    record.
    """
    if len(flights) > _MOST:
        raise ConfigError(f"{len(flights)} flights: at most {_MOST} fit on a page")
    into = out or flights[0].with_suffix(".html")
    if into in flights:
        raise ConfigError(f"--out {into} is one of the flights: give the page another name")
    check_folder_of(into, "out")
    check_output(figures, None)
    check_file(into, "out")
    _Work(flights, into, figures, file_format, as_json).do()


class _Work:
    """Writer of the page and the figures, with a progress bar on a terminal."""

    def __init__(
        self, flights: Sequence[Path], into: Path, figures: Path | None, file_format: Format, as_json: bool
    ) -> None:
        self._flights, self._into, self._figures = flights, into, figures
        from rich.console import Console  # noqa: PLC0415 - nothing that --help would wait for

        self._format, self._as_json = file_format, as_json
        self._console = Console(stderr=as_json)

    def do(self) -> None:
        """Read the flights, draw the figures, write the page; ConfigError when a file cannot be written."""
        from companion.cli.terminal import progress_bar  # noqa: PLC0415

        with progress_bar(self._console) as bar:
            self._bar, self._task = bar, bar.add_task("reading", total=None)
            page, numbers, drawn = self._made()
        lost = kept(self._into, lambda to: _write(to, page))
        if lost:
            raise ConfigError(lost)
        if self._as_json:
            typer.echo(json.dumps({"flights": numbers}))
        self._say(f"report {self._into}")
        if self._figures is not None:
            self._say(f"{drawn} figures in {self._figures}")

    def _say(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def _step(self, what: str) -> None:
        self._bar.update(self._task, description=what, advance=1)

    def _made(self) -> tuple[str, list[dict[str, object]], int]:
        """Return the page, the numbers of each flight, and the count of figures written."""
        from companion.analysis.report.page import chapter_of, page  # noqa: PLC0415
        from companion.analysis.report.recorded_flight import Flown  # noqa: PLC0415 - drawing takes a second to import
        from companion.records.read import read_flight  # noqa: PLC0415

        chapters = []
        for path in self._flights:
            self._step(f"reading {path.name}")
            chapters.append(chapter_of(Flown(read_flight(path))))
        figures = sum(len(chapter.charts) for chapter in chapters)
        total = len(chapters) + figures * (1 if self._figures is None else 2) + (len(chapters) > 1)
        self._bar.update(self._task, total=total)
        html = page(chapters, lambda name: self._step(f"drawing {name}"))
        drawn = 0 if self._figures is None else self._draw(chapters, self._figures)
        return html, [chapter.numbers.as_dict() for chapter in chapters], drawn

    def _draw(self, chapters: "Sequence[Chapter]", folder: Path) -> int:
        from companion.analysis.report.charts import Medium  # noqa: PLC0415
        from companion.analysis.report.compare import overlaid  # noqa: PLC0415
        from companion.analysis.report.number_tables import letters  # noqa: PLC0415

        first = [f"{letter}-" for letter in letters(len(chapters))] if len(chapters) > 1 else [""]
        charts = [
            (f"{letter}{chapter.flown.name}-{chart.name}", chart)
            for letter, chapter in zip(first, chapters, strict=True)
            for chart in chapter.charts
        ]
        if len(chapters) > 1:
            charts += [(chart.name, chart) for chart in overlaid([chapter.flown for chapter in chapters])]
        for name, chart in charts:
            self._step(f"drawing {name}")
            lost = kept(folder / f"{name}.{self._format}", lambda to, one=chart: one.save(to, Medium.PAPER))  # type: ignore[misc]
            if lost:
                raise ConfigError(lost)
        return len(charts)


def _write(to: Path, page: str) -> None:
    to.write_text(page, encoding="utf-8")
