"""Ground's end of the law's link: a session with the vehicle, events and beats up, reports and plans down. Pure.

An event is sent when the law wants it, a beat when nothing was sent for `beat_s`. An event that was not acknowledged
within a round trip is sent again until it is; and while nothing at all is acknowledged, every cycle sends something.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import inf, isfinite, nan

from companion.law_link.agreement import Introduction, refusal_of
from companion.law_link.clock_offset import ClockOffset
from companion.law_link.codec import packed, unpacked
from companion.law_link.ground_session import GroundLinkState, GroundSession, LinkCounts
from companion.law_link.messages import (
    TICK_S,
    BadMessageError,
    Clock,
    Command,
    Kind,
    Plan,
    Pose,
    Report,
    Text,
    UpFlags,
    UpMessage,
    seconds_between,
    short_ticks,
    ticks_of,
)
from companion.law_link.sealing import hello_seal, session_keys
from companion.law_link.sequence_window import Order

_HELLO_S = 0.5
_SILENT_S = 1.0
"""Silence of the vehicle after which a new session is asked for; the old one goes on if the vehicle returns."""
CLOCK_S = 1.0
_JUMP_S = 0.02
"""Change of the clocks' offset that the vehicle is told at once."""
AGAIN_S = 0.01
"""Time beyond a round trip after which a command counts as lost."""
AGAIN_EVERY_S = 0.02
HURRY_S = 0.1
"""Time beyond a round trip without any acknowledgement after which every cycle sends."""


class GroundEnd:
    """Session with one vehicle. Feed it datagrams with `hear`, and call `tick` once a cycle."""

    def __init__(self, secret: bytes, me: Introduction, random: Callable[[int], bytes], beat_s: float) -> None:
        self._secret, self.me, self._beat_s = secret, me, beat_s
        self._hello = hello_seal(secret)
        self._nonce = random(16)
        """Of this process, so that the vehicle tells a new ground law from one that it knows."""
        self._session: GroundSession | None = None
        self._hello_s = -inf
        self.refused = ""
        """Reason for which the vehicle refused the last hello; empty without one."""
        self._refused_s = inf
        """Time since which it refuses for reasons that do not end by themselves; infinite if it does not."""
        self.counts = LinkCounts()
        self.epoch = self.law = 0
        self.flags = UpFlags(0)
        self.pose: Pose | None = None
        """Sent with every message, if there is one."""
        self.asked: Text | None = None
        """Newest question of the vehicle."""
        self._answer: Text | None = None

    @property
    def report(self) -> Report | None:
        """Newest report of the vehicle."""
        return None if self._session is None else self._session.report

    @property
    def plan(self) -> Plan | None:
        """Newest plan of the vehicle."""
        return None if self._session is None else self._session.plan

    @property
    def session(self) -> int | None:
        """Number of the session; None before the first."""
        return None if self._session is None else self._session.number

    @property
    def newest_number(self) -> int:
        """Number of the newest command sent."""
        return 0 if self._session is None else self._session.number_sent

    @property
    def clock(self) -> ClockOffset:
        """Vehicle's clock against ours."""
        return ClockOffset() if self._session is None else self._session.clock

    @property
    def up_age_s(self) -> float:
        """Median age of our messages at their arrival, as the vehicle measures it; NaN while unknown."""
        report = self.report
        return nan if report is None or report.up_age == 0 else report.up_age * TICK_S

    def silence_s(self, now_s: float) -> float:
        """Return the time since the newest report, s; infinite before the first."""
        return inf if self._session is None else now_s - self._session.report_s

    def refused_for_s(self, now_s: float) -> float:
        """Return for how long the vehicle has refused us for reasons that do not end by themselves, s; 0 if not."""
        return max(now_s - self._refused_s, 0.0)

    def state(self, now_s: float) -> GroundLinkState:
        """Return the state of the link now."""
        report, clock = self.report, self.clock
        return GroundLinkState(
            session=self.session or 0,
            number=self.newest_number,
            acknowledged=0 if report is None else report.number,
            phase=None if report is None else report.phase,
            silence_s=self.silence_s(now_s),
            clock_offset_s=clock.offset_s,
            round_trip_s=clock.round_trip_s,
            up_age_s=self.up_age_s,
            counts=replace(self.counts),
        )

    def hear(self, datagram: bytes, now_s: float) -> None:
        """Take one datagram; what is not of this vehicle and session is dropped."""
        s = self._session
        data = None if s is None else s.keys.down.opened(datagram)
        if s is not None and data is not None:
            self.counts.bytes_down += len(datagram)
            self._take(s, data, now_s)
            return
        hello = self._hello.opened(datagram)
        if hello is None:
            return
        with suppress(BadMessageError):
            self._take_reply(hello, now_s)

    def _take_reply(self, data: bytes, now_s: float) -> None:
        """Take a reply to our hello; raises BadMessageError."""
        reply = unpacked(data)
        if not isinstance(reply, Text) or reply.nonce != self._nonce:
            return
        if reply.kind is Kind.REFUSED:
            refusal = refusal_of(reply.text)
            self.refused = refusal.reason
            self._refused_s = inf if refusal.passes else min(self._refused_s, now_s)
        elif reply.kind is Kind.WELCOME:
            self._refused_s = inf
            keys = session_keys(self._secret, self._nonce, reply.vehicle_nonce)
            self._session, self.counts = GroundSession(number=reply.session, keys=keys), LinkCounts()
            self.refused, self.asked, self._answer = "", None, None

    def _take(self, s: GroundSession, data: bytes, now_s: float) -> None:
        try:
            message = unpacked(data)
        except BadMessageError:
            return
        if isinstance(message, UpMessage) or message.session != s.number:
            return
        newest = s.window.take(message.sequence) is Order.NEWEST
        if isinstance(message, Plan):
            s.take_plan(message)
        elif newest and isinstance(message, Report):
            self.counts.reports += 1
            s.take_report(message, now_s)
        elif newest and isinstance(message, Text) and message.kind is Kind.ASK:
            self._take_question(message)

    def _take_question(self, message: Text) -> None:
        if self._answer is not None and self._answer.nonce == message.nonce:
            self.asked = replace(message, text="")  # answered before: the answer is sent again
        elif self.asked is None or self.asked.nonce != message.nonce:
            self.asked, self._answer = message, None

    def answer(self, question: Text, text: str) -> None:
        """Answer a question of the vehicle; the answer is sent as often as the question comes."""
        self._answer = replace(question, kind=Kind.ANSWER, text=text)
        self.asked = replace(question, text="")

    def command(self, command: Command) -> None:
        """Set a new command; `tick` sends it as an event."""
        s = self._session
        if s is None:
            return
        s.command, s.number_sent = command, s.number_sent % 65535 + 1
        s.command_s = s.again_s = -inf

    def tick(self, now_s: float) -> list[bytes]:
        """Return the datagrams to send now; call it once a cycle, after `command`."""
        out = []
        s = self._session
        if s is None or now_s - s.report_s > _SILENT_S:
            out += self._say_hello(now_s)
        if s is not None:
            out += self._messages(s, now_s)
        return out

    def _say_hello(self, now_s: float) -> list[bytes]:
        if now_s - self._hello_s < _HELLO_S:
            return []
        self._hello_s = now_s
        return [self._hello.sealed(packed(Text(kind=Kind.HELLO, nonce=self._nonce, text=self.me.text())))]

    def _messages(self, s: GroundSession, now_s: float) -> list[bytes]:
        out = []
        if self._answer is not None and self.asked is not None:
            self.asked = None
            out.append(self._sealed(s, replace(self._answer, session=s.number, sequence=self._next(s))))
        new = s.command is not None and s.command_s == -inf
        if new or self._due_again(s, now_s):
            self.counts.events += new
            self.counts.again += not new
            s.command_s = now_s if new else s.command_s
            s.again_s = now_s
            out.append(self._state(s, Kind.EVENT, now_s))
        if self._clock_is_due(s, now_s):  # also beside events that leave no time for beats
            s.clock_s, s.clock_told_s = now_s, s.clock.offset_s
            self.counts.beats += 1
            out.append(self._state(s, Kind.CLOCK, now_s))
        elif s.sent_s < now_s and now_s - s.sent_s >= self._interval_s(s, now_s) - 0.5 * TICK_S:
            self.counts.beats += 1
            out.append(self._state(s, Kind.BEAT, now_s))
        return out

    def _due_again(self, s: GroundSession, now_s: float) -> bool:
        """Return True if the vehicle should have acknowledged the newest command by now, and has not."""
        if s.report is None or s.command is None or s.report.number == s.number_sent:
            return False
        if not self.flags & UpFlags.FLYING:  # a vehicle that stands uses no command, and acknowledges none
            return False
        every_s = 0.0 if self._hurries(s, now_s) else AGAIN_EVERY_S
        is_lost = now_s - s.command_s > self._round_trip_s() + AGAIN_S
        return is_lost and now_s - s.again_s >= every_s - TICK_S

    def _interval_s(self, s: GroundSession, now_s: float) -> float:
        return 0.0 if self._hurries(s, now_s) else self._beat_s

    def _hurries(self, s: GroundSession, now_s: float) -> bool:
        """Return True if nothing was acknowledged lately, in flight."""
        if s.report is None or not self.flags & UpFlags.FLYING:
            return False
        return seconds_between(ticks_of(now_s), s.report.echo) > self._round_trip_s() + HURRY_S

    @staticmethod
    def _clock_is_due(s: GroundSession, now_s: float) -> bool:
        offset_s = s.clock.offset_s
        jumped = abs(offset_s - s.clock_told_s) > _JUMP_S
        return isfinite(offset_s) and (jumped or now_s - s.clock_s >= CLOCK_S)

    def _round_trip_s(self) -> float:
        """Return the usual round trip: the quickest one, with twice the median age up for what jitter adds."""
        quickest_s = self.clock.round_trip_s
        usual_s = 2.0 * self.up_age_s
        return max(one for one in (quickest_s, usual_s, 0.0) if isfinite(one))

    def _state(self, s: GroundSession, kind: Kind, now_s: float) -> bytes:
        message = UpMessage(
            kind=kind,
            session=s.number,
            sequence=self._next(s),
            stamp=ticks_of(now_s),
            number=s.number_sent,
            epoch=self.epoch,
            law=self.law,
            flags=self.flags,
            command=self._command_of(s, now_s) if kind is Kind.EVENT else None,
            pose=self.pose,
            clock=self._clock_of(s) if kind is Kind.CLOCK else None,
        )
        s.sent_s = now_s
        return self._sealed(s, message)

    @staticmethod
    def _command_of(s: GroundSession, now_s: float) -> Command | None:
        """Return the newest command; its frame is older when it is sent again."""
        if s.command is None or now_s <= s.command_s:
            return s.command
        ago = s.command.capture_ago + round((now_s - s.command_s) / TICK_S)
        return replace(s.command, capture_ago=min(ago, 65535))

    def _clock_of(self, s: GroundSession) -> Clock:
        c = self.counts
        trip = short_ticks(s.clock.round_trip_s)
        return Clock(offset=ticks_of(s.clock.offset_s), sent_bytes=c.bytes_up, again=c.again, round_trip=trip)

    @staticmethod
    def _next(s: GroundSession) -> int:
        s.sent += 1
        return s.sent

    def _sealed(self, s: GroundSession, message: "UpMessage | Text") -> bytes:
        data = s.keys.up.sealed(packed(message))
        self.counts.bytes_up += len(data)
        return data
