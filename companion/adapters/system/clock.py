"""The machine's monotonic clock: the only place that reads it for the flight code."""

import time


class MonotonicClock:
    """Clock interface on time.monotonic, s."""

    def now_s(self) -> float:
        """Return the monotonic time, s, from an arbitrary origin before this process."""
        return time.monotonic()
