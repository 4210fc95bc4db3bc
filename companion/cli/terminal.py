"""Tables, progress and cursor of all commands that draw on a terminal."""

from collections.abc import Iterable, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text


def numbers_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str | Text]]) -> Group:
    """Return a titled table of words in the first column and numbers in the others; no text is read as markup."""
    table = Table(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0), pad_edge=False)
    for index, name in enumerate(columns):
        table.add_column(Text(name), justify="right" if index else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in row))
    return Group("", Text(title, style="bold"), table)


def progress_bar(console: Console) -> Progress:
    """Return a progress bar with task, finished parts, elapsed and remaining time, that vanishes at the end."""
    done = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*done, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True)


def show_cursor(console: Console) -> None:
    """Show the cursor that a live display hides: a killed process could not restore it."""
    if console.is_terminal:
        console.show_cursor(True)
