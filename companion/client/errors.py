"""What can be wrong between an operator and the service, as sentences."""

from companion.core.errors import CompanionError


class NobodyThereError(CompanionError):
    """No broker, or no service on it."""


class LostError(CompanionError):
    """A command may have been carried out, and it is not known how it ended."""
