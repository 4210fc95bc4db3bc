"""Rows of a CSV file into numbers, and what is wrong with them into sentences."""

import math
from pathlib import Path

from companion.ports import ConfigError


def numbers_of(row: list[str], count: int, line: int, path: Path) -> list[float]:
    """The row's `count` finite values; ConfigError naming file and line."""
    if len(row) != count:
        raise ConfigError(f"{path}: line {line}: {count} values are needed, there are {len(row)}")
    try:
        values = [float(cell) for cell in row]
    except ValueError as error:
        raise ConfigError(f"{path}: line {line}: every value must be a number, not {','.join(row)!r}") from error
    if not all(math.isfinite(value) for value in values):
        raise ConfigError(f"{path}: line {line}: every value must be finite, not {','.join(row)!r}")
    return values
