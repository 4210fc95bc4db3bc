"""Times of messages up, on the clocks of both sides. Pure."""

from dataclasses import dataclass
from math import nan

from companion.law_link.messages import TICK_S, Clock, seconds_between, ticks_of


@dataclass(frozen=True, kw_only=True)
class MessageTimes:
    """Times of one message up, s; NaN while unknown."""

    sent_ground_s: float = nan
    """On the ground's clock, which is known modulo 119 hours."""
    sent_s: float = nan
    """On the vehicle's clock; NaN until the ground has told the offset."""
    arrived_s: float = nan
    """On the vehicle's clock."""


@dataclass(frozen=True, kw_only=True)
class LinkTimes:
    """Clocks and newest messages of a session."""

    session: int = 0
    """Random number of the session; 0 without one."""
    clock_offset_s: float = nan
    """Vehicle's clock less the ground's, which is known modulo 119 hours; NaN until the ground has told it."""
    message: MessageTimes = MessageTimes()
    """Newest message of any kind."""
    command: MessageTimes = MessageTimes()
    """Message that brought the newest command."""
    law: int = 0
    """Number of the law that computed the newest command, counted at each switch on the ground."""
    capture_ago_s: float = nan
    """Age of the frame that the newest command was computed from, when it was sent."""


def offset_s_of(clock: Clock | None) -> float:
    """Return the vehicle's clock less the ground's, s; NaN while unknown."""
    return nan if clock is None else seconds_between(clock.offset, 0)


def times_of(stamp: int, arrived_s: float, clock: Clock | None) -> MessageTimes:
    """Return the times of a message that was sent at `stamp` on the ground's clock."""
    age_s = nan if clock is None else seconds_between(ticks_of(arrived_s), stamp + clock.offset)
    return MessageTimes(sent_ground_s=stamp * TICK_S, sent_s=arrived_s - age_s, arrived_s=arrived_s)
