"""Tables of text for terminal and page."""

from dataclasses import dataclass, replace

GOOD, BAD, PLAIN, FAINT = "good", "bad", "plain", "faint"
WORDS = "words"
"""Tone of a sentence, which a page shows and a terminal leaves out."""


@dataclass(frozen=True)
class Cell:
    """Text of a cell and its tone."""

    text: str
    tone: str = PLAIN


@dataclass(frozen=True)
class Grid:
    """Table with names in the first column, numbers in the others, and optionally a sentence in the last."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    @property
    def narrow(self) -> "Grid":
        """Table without the columns of sentences."""
        kept = [index for index, cell in enumerate(self.rows[0]) if cell.tone != WORDS]
        rows = tuple(tuple(row[index] for index in kept) for row in self.rows)
        return replace(self, columns=tuple(self.columns[index] for index in kept), rows=rows)
