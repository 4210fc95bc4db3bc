"""What several commands are asked in the same words, and how they end."""

import re

from companion.client.errors import LostError, NobodyThereError
from companion.core.errors import CompanionError, ConfigError

FAILED = 1
"""Exit code: begun, and not ended well."""
BAD_INPUT = 2
"""Exit code: refused, or not begun."""
NOBODY, LOST = 3, 4
"""Exit codes: no service there; it is not known how it ended."""
INTERRUPTED = 130
"""Exit code: Ctrl-C."""
_MOST_SEEDS = 1000


def code_of(error: CompanionError) -> int:
    """Return the exit code of what went wrong."""
    return NOBODY if isinstance(error, NobodyThereError) else LOST if isinstance(error, LostError) else BAD_INPUT


def names_of(text: str, option: str) -> tuple[str, ...]:
    """Names or files between commas, spaces around them or not; `option` without its dashes. ConfigError for none."""
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise ConfigError(f"--{option} {text!r}: give at least one name or TOML file")
    return names


def seeds_of(text: str) -> tuple[int, ...]:
    """FIRST:LAST, both among them, or one seed alone; ConfigError for anything else and for too many."""
    asked = re.fullmatch(r"([0-9]{1,9})(?::([0-9]{1,9}))?", text.strip())
    first, last = (int(asked[1]), int(asked[2] or asked[1])) if asked else (1, 0)
    if first > last:
        raise ConfigError(
            f"--seeds {text}: must be FIRST:LAST, two whole numbers from 0 on in this order, as in 1:5, or one seed"
        )
    if last - first >= _MOST_SEEDS:
        raise ConfigError(f"--seeds {text}: {last - first + 1} seeds, at most {_MOST_SEEDS} fly side by side")
    return tuple(range(first, last + 1))
