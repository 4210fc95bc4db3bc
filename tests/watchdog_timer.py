"""A watchdog timer without effect, for flights inside the test's own process, which the kernel would otherwise kill."""


class NoWatchdogTimer:
    """A WatchdogTimer (core.interfaces) that never expires."""

    def renew(self) -> None:
        """Accept the renewal without effect."""

    def release(self) -> None:
        """Accept the release without effect."""
