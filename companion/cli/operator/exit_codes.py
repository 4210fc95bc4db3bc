"""Exit codes, and the lists of names and seeds that several commands parse."""

import re
from collections.abc import Iterable

from companion.client.errors import FailedError, NoServiceError, UnknownOutcomeError
from companion.core.errors import CompanionError, ConfigError

FAILED = 1
"""Exit code: begun, but failed."""
BAD_INPUT = 2
"""Exit code: refused or bad input, nothing begun."""
NOBODY, LOST = 3, 4
"""Exit codes: no service answers; the outcome is not known."""
INTERRUPTED = 130
"""Exit code: Ctrl-C."""
_BY_WEIGHT = (0, BAD_INPUT, NOBODY, FAILED, LOST, INTERRUPTED)
"""From the best to the worst: nothing changed, begun and failed, not known."""
_MOST_SEEDS = 1000


def code_of(error: CompanionError) -> int:
    """Return the exit code that belongs to `error`."""
    codes = ((FailedError, FAILED), (NoServiceError, NOBODY), (UnknownOutcomeError, LOST))
    return next((code for kind, code in codes if isinstance(error, kind)), BAD_INPUT)


def worst(codes: Iterable[int]) -> int:
    """Return the exit code of several vehicles' commands: the worst of theirs."""
    return max(codes, key=_BY_WEIGHT.index, default=0)


def names_of(text: str, option: str) -> tuple[str, ...]:
    """Split comma-separated names or files and strip spaces; `option` is without its dashes. ConfigError if empty."""
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise ConfigError(f"--{option} {text!r}: give at least one name or TOML file")
    return names


def seeds_of(text: str) -> tuple[int, ...]:
    """Parse FIRST:LAST (inclusive) or one seed; ConfigError for anything else and for too many seeds."""
    found = re.fullmatch(r"([0-9]{1,9})(?::([0-9]{1,9}))?", text.strip())
    first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
    if first > last:
        raise ConfigError(
            f"--seeds {text}: must be FIRST:LAST, two whole numbers from 0 on in this order, as in 1:5, or one seed"
        )
    if last - first >= _MOST_SEEDS:
        raise ConfigError(f"--seeds {text}: {last - first + 1} seeds, at most {_MOST_SEEDS} fly side by side")
    return tuple(range(first, last + 1))
