"""The machine's monotonic clock: the only place that reads it for the flight code."""

import time


class MonotonicClock:
    """Clock interface on time.monotonic, s."""

    def now_s(self) -> float:
        """Seconds since some instant before this process; never goes back."""
        return time.monotonic()
