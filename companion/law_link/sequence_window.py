"""Sequence numbers of a session: what is new, late, or played again. Pure."""

from enum import StrEnum

_BITS = 64


class Order(StrEnum):
    """Order of a message in its session."""

    NEWEST = "newest"
    LATE = "late"
    """An earlier one that had not arrived yet."""
    REPEATED = "repeated"
    """One that was received before: duplicated on the way, or played again."""


class SequenceWindow:
    """Newest sequence number, and which of the 64 before it were received (RFC 4303, section 3.4.3)."""

    def __init__(self) -> None:
        self.newest = 0
        """0 before the first; sequences begin with 1."""
        self._seen = 0

    def take(self, sequence: int) -> Order:
        """Enter a sequence number and return its order; what is too old to be known counts as repeated."""
        ahead = sequence - self.newest
        if ahead > 0:
            self._seen = ((self._seen << ahead) | 1) & ((1 << _BITS) - 1) if ahead < _BITS else 1
            self.newest = sequence
            return Order.NEWEST
        if -ahead >= _BITS or self._seen >> -ahead & 1:
            return Order.REPEATED
        self._seen |= 1 << -ahead
        return Order.LATE
