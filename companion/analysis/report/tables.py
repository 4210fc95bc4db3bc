"""Tables of words, for a terminal and for a page alike."""

from dataclasses import dataclass, replace

GOOD, BAD, PLAIN, FAINT = "good", "bad", "plain", "faint"
WORDS = "words"
"""A sentence: a page has room for it, a terminal has not."""


@dataclass(frozen=True)
class Cell:
    """A few words and how they are meant."""

    text: str
    tone: str = PLAIN


@dataclass(frozen=True)
class Grid:
    """A table: names in the first column, numbers in the others, and perhaps a sentence in the last."""

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
