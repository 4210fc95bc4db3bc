"""Errors between an operator and the service."""

from companion.core.errors import CompanionError


class NobodyThereError(CompanionError):
    """Failure to find a broker, or a service on it."""


class LostError(CompanionError):
    """Loss of the replies to a command: it may have been carried out, and its end is not known."""
