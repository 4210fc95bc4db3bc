"""Session with one ground law, on the vehicle: what has come in it. Pure."""

from dataclasses import dataclass, replace
from math import inf, nan

from companion.law_link.agreement import Introduction
from companion.law_link.link_status import LinkStatus, RecentAges, SecondCount, UpCounts
from companion.law_link.link_times import LinkTimes, MessageTimes, offset_s_of, times_of
from companion.law_link.messages import (
    TICK_S,
    Clock,
    Command,
    Pose,
    Text,
    UpFlags,
    UpMessage,
    is_number_newer,
    seconds_between,
    ticks_of,
)
from companion.law_link.sealing import SessionKeys
from companion.law_link.sequence_window import Order, SequenceWindow


@dataclass(frozen=True, kw_only=True)
class HeldCommand:
    """Newest command of the ground law, which the vehicle holds."""

    number: int
    epoch: int
    law: int
    command: Command
    stamp: int
    """Ground's clock when the message with it was sent."""
    received_s: float
    """Arrival on the vehicle's clock."""


class VehicleSession:
    """Newest message, command and pose of a ground law, and counts of its messages."""

    def __init__(self, number: int, keys: SessionKeys, ground_nonce: bytes, who: Introduction) -> None:
        self.number, self.keys, self.ground_nonce, self.who = number, keys, ground_nonce, who
        self.sent = 0
        """Messages sent to the ground law."""
        self.newest: UpMessage | None = None
        self.newest_s = -inf
        """Arrival of the newest message."""
        self.held: HeldCommand | None = None
        self.pose: tuple[Pose, float] | None = None
        """Newest pose that a message carried, and the time (s) at which it was sent."""
        self._window = SequenceWindow()
        self._newest_sent_s = self._seen_s = -inf
        self._clock: Clock | None = None
        self._events = self._used = self._all = self._bytes = 0
        self._ages, self.used_ages = RecentAges(), RecentAges()
        self._received, self._missing, self._late = SecondCount(), SecondCount(), SecondCount()

    def take(self, message: UpMessage | Text, size: int, now_s: float) -> bool:
        """Take a message of `size` bytes; return False for one that was received before, which changes nothing."""
        newest_before = self._window.newest
        order = self._window.take(message.sequence)
        if order is Order.REPEATED:
            return False
        self._all += 1
        self._bytes += size
        if order is Order.LATE:
            self._late.note(now_s)
            self._missing.note(now_s, -1)
        else:
            self._received.note(now_s)
            self._missing.note(now_s, message.sequence - newest_before - 1)
        if isinstance(message, UpMessage):
            if order is Order.NEWEST:
                self._take_state(message, now_s)
            self._take_command(message, now_s)
            self._confirm()
        return True

    def _take_state(self, message: UpMessage, now_s: float) -> None:
        if message.clock is not None:
            self._clock = message.clock
        self._events += (message.number - (self.newest.number if self.newest else 0)) % 65535
        age_s = 0.0
        if self._clock is not None:
            age_s = seconds_between(ticks_of(now_s), message.stamp + self._clock.offset)
            self._ages.note(now_s, age_s)
        self.newest, self.newest_s, self._newest_sent_s = message, now_s, now_s - max(age_s, 0.0)
        if message.pose is not None:
            self.pose = message.pose, self._newest_sent_s

    def _take_command(self, message: UpMessage, now_s: float) -> None:
        """Take a command that is newer than the one held, also from a message that a beat has overtaken."""
        before = self.held
        if message.command is not None and (before is None or is_number_newer(message.number, before.number)):
            self.held = HeldCommand(
                number=message.number,
                epoch=message.epoch,
                law=message.law,
                command=message.command,
                stamp=message.stamp,
                received_s=now_s,
            )

    def _confirm(self) -> None:
        """Note that the command held is the ground law's newest, which a beat after a lost event does not say."""
        newest, held = self.newest, self.held
        if newest is None or newest.flags & (UpFlags.BLIND | UpFlags.FAILED):
            return
        unused = not newest.flags & UpFlags.FLYING  # on the ground no command is used, and none sent again
        if unused or newest.number == (0 if held is None else held.number):
            self._seen_s = max(self._seen_s, self._newest_sent_s)

    def use(self, now_s: float) -> HeldCommand | None:
        """Return the newest command at the begin of a control cycle, when it is put to use; None before the first."""
        newest, clock = self.newest, self._clock
        if newest is not None and clock is not None and newest.sequence != self._used:
            self._used = newest.sequence
            self.used_ages.note(now_s, seconds_between(ticks_of(now_s), newest.stamp + clock.offset))
        return self.held

    def status(self, around: LinkStatus, now_s: float) -> LinkStatus:
        """Return the state of the link now; `around` says what does not belong to the session."""
        flags = self.newest.flags if self.newest is not None else UpFlags(0)
        return replace(
            around,
            connected=True,
            law=self.who.law,
            host=self.who.host,
            session=self.number,
            round_trip_s=nan if self._clock is None else self._clock.round_trip * TICK_S,
            silence_s=now_s - self._seen_s,
            blind=bool(flags & UpFlags.BLIND),
            failed=bool(flags & UpFlags.FAILED),
            age_s=self._ages.median_s,
            received=self._received.sum(now_s),
            missing=max(self._missing.sum(now_s), 0),
            late=self._late.sum(now_s),
        )

    @property
    def counts(self) -> UpCounts:
        """Messages that the ground law has sent in this session."""
        return UpCounts(
            messages=self._window.newest,
            events=self._events,
            again=0 if self._clock is None else self._clock.again,
            sent_bytes=0 if self._clock is None else self._clock.sent_bytes,
            received=self._all,
            received_bytes=self._bytes,
        )

    @property
    def times(self) -> LinkTimes:
        """Clocks and newest messages of the session."""
        newest, held, clock = self.newest, self.held, self._clock
        if newest is None:
            return LinkTimes()
        return LinkTimes(
            session=self.number,
            clock_offset_s=offset_s_of(clock),
            message=times_of(newest.stamp, self.newest_s, clock),
            command=MessageTimes() if held is None else times_of(held.stamp, held.received_s, clock),
            law=0 if held is None else held.law,
            capture_ago_s=nan if held is None else held.command.capture_ago * TICK_S,
        )
