"""Tables of numbers in CSV files, as editors, spreadsheets and planners write them; what is wrong is one sentence."""

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.config.text_files import read_text
from companion.core.errors import ConfigError
from companion.core.types import Array

_SEPARATORS = ",;\t"
_MARK = "t_s"
"""The column that every table here has; a comment that names it is a header, as numpy.savetxt writes one."""
_SHOWN = 60
"""Characters of a file that a sentence repeats at most."""
_Row = tuple[int, list[str]]
"""The number of its line, and its cells."""


@dataclass(frozen=True, kw_only=True)
class CsvTable:
    """A header and rows of numbers."""

    path: Path
    header: tuple[str, ...]
    """In lower case, without quotes and spaces."""
    header_text: str
    """The first line as it stands in the file, for sentences."""
    separator: str
    rows: tuple[_Row, ...]

    def numbers(self) -> Array:
        """Return the finite values, (rows, columns); ConfigError naming the line of the first that is none."""
        point = self._decimal_point()
        return np.array([self._numbers_of(line, cells, point) for line, cells in self.rows])

    def wrong(self, row: int, what: str) -> ConfigError:
        """Return an error about a row, counted from 0, that names its line."""
        return ConfigError(f"{self.path}: line {self.rows[row][0]}: {what}")

    def _numbers_of(self, line: int, cells: list[str], point: str) -> list[float]:
        said = repr(_short(",".join(cells)))
        if len(cells) != len(self.header):
            hint = ": are there decimal commas? Separate the columns by ';'" if len(cells) > len(self.header) else ""
            raise ConfigError(
                f"{self.path}: line {line}: {len(self.header)} values are needed, there are {len(cells)}{hint}"
            )
        try:
            values = [_number(cell.replace(point, ".")) for cell in cells]
        except ValueError as error:
            raise ConfigError(f"{self.path}: line {line}: every value must be a number, not {said}") from error
        if not all(math.isfinite(value) for value in values):
            raise ConfigError(f"{self.path}: line {line}: every value must be finite, not {said}")
        return values

    def _decimal_point(self) -> str:
        """Return the decimal mark: a comma where none separates columns; ConfigError where both marks are used."""
        if self.separator == ",":
            return "."  # "1,234" in quotes: nobody knows whether it is a thousand
        points, commas = ([line for line, cells in self.rows if any(mark in cell for cell in cells)] for mark in ".,")
        if points and commas:
            raise ConfigError(
                f"{self.path}: line {commas[0]} has a comma in a number, line {points[0]} a point: which is decimal?"
            )
        return "," if commas else "."


def read_table(path: Path, wanted: str) -> CsvTable:
    """Return the table in a CSV file; `wanted` is its first line as it should be, for the sentence that asks for it.

    Columns are separated by commas, semicolons, tabs or spaces; behind any of these but a comma, decimal commas are
    read, too. Left out are a byte order mark, lines that are blank, empty cells at the end of lines, lines in front of
    the header that begin with #, and such lines of one cell behind it. Raises ConfigError for any other file.
    """
    lines = io.StringIO(read_text(path), newline=None).read().split("\n")  # also where lines end with \r alone
    first = _header_line(lines)
    if first is None:
        raise ConfigError(f"{path}: is empty; the first line must be {wanted}")
    top = lines[first].strip().lstrip("#")
    separator = _separator(lines[:first], top)
    (_, header), *rows = _rows([*[""] * first, top, *lines[first + 1 :]], separator, path)
    table = CsvTable(
        path=path,
        header=tuple(cell.lower() for cell in header),
        header_text=lines[first].strip(),
        separator=separator,
        rows=tuple(rows),
    )
    if _MARK not in table.header:
        raise wrong_header(table, wanted)
    return table


def wrong_header(table: CsvTable, wanted: str) -> ConfigError:
    """Return the error that says what the first line must be, and what it is."""
    return ConfigError(f"{table.path}: the first line must be {wanted}; it is {_short(table.header_text)!r}")


def _header_line(lines: list[str]) -> int | None:
    """Return the first line that is neither blank, a comment, nor Excel's `sep=;`; None when there is none."""
    for number, line in enumerate(lines):
        text = line.strip(" \t,;")
        comment = text.startswith("#") and _MARK not in text.lower().replace(",", " ").replace(";", " ").split()
        if text and not comment and not text.lower().startswith("sep="):
            return number
    return None


def _separator(before: list[str], header: str) -> str:
    """Return the column separator: as Excel's `sep=` says, else as the header shows; a space when there is no other."""
    said = [line.strip() for line in before if line.lower().startswith("sep=")]
    if said and said[0][4:5] in set(_SEPARATORS):
        return said[0][4]
    try:
        return str(csv.Sniffer().sniff(header, delimiters=_SEPARATORS).delimiter)
    except csv.Error:
        return " "


def _rows(lines: list[str], separator: str, path: Path) -> Iterator[_Row]:
    """Yield the rows that hold something, with the number of the line on which each begins."""
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    begun = 1
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            comment = bool(cells) and cells[0].startswith("#") and not any(cells[1:])
            if any(cells) and not comment:
                while not cells[-1]:
                    cells.pop()
                yield begun, cells
            begun = reader.line_num + 1
    except csv.Error as error:
        raise ConfigError(f"{path}: line {begun}: cannot be read as CSV: {error}") from error


def _number(cell: str) -> float:
    """Convert as `float` does; ValueError also for 1_000 and for digits of other scripts."""
    if not cell.isascii() or "_" in cell:
        raise ValueError(cell)
    return float(cell)


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + "..."
