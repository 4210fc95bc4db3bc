"""No dead man, for flights inside of the test's own process: the kernel would end the tests with it."""


class NoDeadMan:
    """ports.DeadMan that lets everybody live."""

    def renew(self) -> None:
        """Nothing to renew."""

    def release(self) -> None:
        """Nothing to release."""
