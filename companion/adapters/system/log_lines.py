"""Lines of others in our log: harmless to a terminal, and not more of them than a log can bear."""

import math
import time
from collections.abc import Callable


def printable(text: str) -> str:
    """Replace control characters, which a terminal or a log would obey, and strip the text."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text.strip())


class LineLimit:
    """Lets a number of lines through in each window of time, and then says how many there were beside them."""

    def __init__(self, most: int = 20, window_s: float = 10.0) -> None:
        self._most, self._window_s = most, window_s
        self._begun_s, self._passed, self._dropped = -math.inf, 0, 0

    def take(self, now_s: float) -> int | None:
        """Return how many were dropped before this line, or None when it is to be dropped, too."""
        if now_s - self._begun_s > self._window_s:
            self._begun_s, self._passed = now_s, 0
        if self._passed >= self._most:
            self._dropped += 1
            return None
        self._passed += 1
        dropped, self._dropped = self._dropped, 0
        return dropped

    def log(self, log: Callable[[str], None]) -> None:
        """Call `log` with the end of its line, a count of those left out, unless there are too many lines."""
        dropped = self.take(time.monotonic())
        if dropped is not None:
            log(f" ({dropped} lines before this one are left out)" if dropped else "")
