"""Errors of reading records; a module without expensive imports."""

from companion.core.errors import CompanionError


class RecordError(CompanionError):
    """A file is no record, or does not have what is asked of it."""


class UnfitFlightError(RecordError):
    """A record that can be read, of a flight that does not show what is asked for."""
