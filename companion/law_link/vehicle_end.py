"""Vehicle's end of the law's link: one ground law at a time, its newest command, and reports to it. Pure.

A session begins only while no flight is on, so that a ground law that comes back, or a second one, never takes over in
the air. Datagrams that are not of the session are counted and dropped, whatever they contain.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf, isfinite, nan

from companion.law_link.agreement import Introduction, Refusal, difference, introduction_of
from companion.law_link.codec import packed, unpacked
from companion.law_link.link_status import NO_LINK, LinkStatus, RecentAges, SecondCount, UpCounts
from companion.law_link.link_times import LinkTimes, MessageTimes, offset_s_of, times_of
from companion.law_link.messages import (
    MESSAGE,
    TICK_S,
    BadMessageError,
    Clock,
    Command,
    DownFlags,
    Kind,
    Plan,
    Pose,
    Report,
    Text,
    UpFlags,
    UpMessage,
    is_number_newer,
    seconds_between,
    short_ticks,
    ticks_of,
)
from companion.law_link.sealing import Seal, SessionKeys, hello_seal, session_keys
from companion.law_link.sequence_window import Order, SequenceWindow

Random = Callable[[int], bytes]
"""Returns this many random bytes."""
_ASK_AGAIN_S = 0.1
_REPLY_S = 0.2
"""Shortest time between two replies to hellos: nobody is answered more often than it helps."""
_LONG_AGO_S = 6.0


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


@dataclass(frozen=True, kw_only=True)
class Shown:
    """State that the flight shows to the ground law."""

    airborne: bool
    cut: bool
    arming: bool
    phase: int
    """Place of the phase in `supervisor.flight_state.Phase`."""
    epoch: int
    number: int
    """Number of the command in use; 0 without one."""
    q_w_flu_wxyz: tuple[float, float, float, float]
    thrust: float


@dataclass(kw_only=True)
class _Session:
    """Session with one ground law."""

    number: int
    keys: SessionKeys
    ground_nonce: bytes
    who: Introduction
    window: SequenceWindow = field(default_factory=SequenceWindow)
    sent: int = 0
    received: int = 0
    received_bytes: int = 0
    newest: UpMessage | None = None
    newest_s: float = -inf
    """Arrival of the newest message."""
    newest_sent_s: float = -inf
    """Time at which it was sent, by the vehicle's clock."""
    seen_s: float = -inf
    """The same of the newest message by which a ground law with a pose confirms the command that is held."""
    clock: Clock | None = None
    events: int = 0
    used: int = 0
    """Sequence of the newest message that a cycle has used."""
    held: HeldCommand | None = None
    pose: tuple[Pose, float] | None = None


class VehicleEnd:
    """Sessions, and what came in them. Feed it datagrams with `hear`; `report`, `plan` and `poll` return others."""

    def __init__(self, secret: bytes, me: Introduction, random: Random) -> None:
        self._secret, self._me, self._random = secret, me, random
        self._hello = hello_seal(secret)
        self._session: _Session | None = None
        self._pending: _Session | None = None
        """Session that was offered; it begins with the first message that proves its key."""
        self.locked = False
        """True while a flight is on: no session begins."""
        self._ages, self._used_ages = RecentAges(), RecentAges()
        self._received, self._missing, self._late, self._foreign = (SecondCount() for _ in range(4))
        self._foreign_from, self._rival, self._rival_s, self._refused = "", "", -inf, ""
        self._replied_s = -inf
        self._asked: tuple[str, float] | None = None
        self._asks = 0
        self.answers: list[str] = []
        """Answers to `ask`, as they came; whoever reads one removes it."""
        self.unreported = False
        """A command, new or repeated, has arrived since the last report."""
        self._accepted = self.bytes_down = 0
        """Messages accepted; payload bytes sent in sessions, tags included."""

    @property
    def received(self) -> int:
        """Messages that were accepted in sessions so far."""
        return self._accepted

    @property
    def pose(self) -> tuple[Pose, float] | None:
        """Newest pose that a message carried, and the time (s) at which it was sent; None without one."""
        return None if self._session is None else self._session.pose

    def hear(self, datagram: bytes, now_s: float, source: str) -> bytes | None:
        """Take one datagram from `source`; return a reply to it, if there is one."""
        for session in (self._session, self._pending):
            data = None if session is None else session.keys.up.opened(datagram)
            if session is not None and data is not None:
                self._take(session, data, len(datagram), now_s, source)
                return None
        hello = self._hello.opened(datagram)
        if hello is None:
            self._note_foreign(now_s, source)
            return None
        try:
            return self._answer_hello(unpacked(hello), now_s, source)
        except BadMessageError:
            self._note_foreign(now_s, source)
            return None

    def _note_foreign(self, now_s: float, source: str) -> None:
        self._foreign.note(now_s)
        self._foreign_from = source

    def _answer_hello(self, hello: MESSAGE, now_s: float, source: str) -> bytes | None:
        if not isinstance(hello, Text) or hello.kind is not Kind.HELLO:
            self._note_foreign(now_s, source)
            return None
        if now_s - self._replied_s < _REPLY_S:
            return None
        who = introduction_of(hello.text)
        same = self._session is not None and hello.nonce == self._session.ground_nonce
        if same and (self.locked or self._heard_lately(now_s)):
            return None  # it goes on in its session
        self._replied_s = now_s
        refusal = self._refusal(who, now_s)
        if refusal is None:
            return self._welcome(hello.nonce, who)
        if difference(self._me, who) == "":
            self._rival, self._rival_s = who.host, now_s
        self._refused = refusal.reason
        return self._hello.sealed(packed(Text(kind=Kind.REFUSED, nonce=hello.nonce, text=refusal.text())))

    def _refusal(self, who: Introduction, now_s: float) -> Refusal | None:
        """Return why this ground law gets no session now; None if it may have one."""
        if self._session is not None and self._heard_lately(now_s):
            return Refusal(f"the ground law on {self._session.who.host} has this vehicle: stop it first")
        if self.locked:
            why = "a flight is on: a ground law may begin only while the vehicle stands disarmed, or is landed"
            return Refusal(why, passes=True)
        differs = difference(self._me, who)
        return Refusal(differs) if differs else None

    def _heard_lately(self, now_s: float) -> bool:
        return self._session is not None and now_s - self._session.newest_s < 1.0

    def _welcome(self, ground_nonce: bytes, who: Introduction) -> bytes:
        vehicle_nonce = self._random(16)
        number = int.from_bytes(self._random(2), "little")
        keys = session_keys(self._secret, ground_nonce, vehicle_nonce)
        self._pending = _Session(number=number, keys=keys, ground_nonce=ground_nonce, who=who)
        welcome = Text(
            kind=Kind.WELCOME,
            session=number,
            nonce=ground_nonce,
            vehicle_nonce=vehicle_nonce,
            text=json.dumps({"vehicle": self._me.host}),
        )
        return self._hello.sealed(packed(welcome))

    def _take(self, session: _Session, data: bytes, size: int, now_s: float, source: str) -> None:
        try:
            message = unpacked(data)
        except BadMessageError:
            self._note_foreign(now_s, source)
            return
        if not isinstance(message, UpMessage | Text) or message.session != session.number:
            self._note_foreign(now_s, source)
            return
        if session is self._pending:
            if self.locked:
                return
            self._session, self._pending, self._refused = session, None, ""
            self._ages, self._used_ages = RecentAges(), RecentAges()
        newest_before = session.window.newest
        order = session.window.take(message.sequence)
        if order is Order.REPEATED:
            self._note_foreign(now_s, source)
            return
        self._accepted += 1
        session.received += 1
        session.received_bytes += size
        if order is Order.LATE:
            self._late.note(now_s)
            self._missing.note(now_s, -1)
        else:
            self._received.note(now_s)
            self._missing.note(now_s, message.sequence - newest_before - 1)
        if isinstance(message, Text):
            self._take_answer(message)
            return
        if order is Order.NEWEST:
            self._take_state(session, message, now_s)
        self._take_command(session, message, now_s)
        self._confirm(session)

    def _take_answer(self, message: Text) -> None:
        if self._asked is not None and message.kind is Kind.ANSWER and message.nonce == self._ask_nonce():
            self._asked = None
            self.answers.append(message.text)

    def _take_state(self, session: _Session, message: UpMessage, now_s: float) -> None:
        if message.clock is not None:
            session.clock = message.clock
        session.events += (message.number - (session.newest.number if session.newest else 0)) % 65535
        age_s = 0.0
        if session.clock is not None:
            age_s = seconds_between(ticks_of(now_s), message.stamp + session.clock.offset)
            self._ages.note(now_s, age_s)
        session.newest, session.newest_s, session.newest_sent_s = message, now_s, now_s - max(age_s, 0.0)
        if message.pose is not None:
            session.pose = message.pose, session.newest_sent_s

    def _take_command(self, session: _Session, message: UpMessage, now_s: float) -> None:
        """Take a command that is newer than the one held, also from a message that a beat has overtaken."""
        before = session.held
        self.unreported |= message.command is not None
        if message.command is not None and (before is None or is_number_newer(message.number, before.number)):
            session.held = HeldCommand(
                number=message.number,
                epoch=message.epoch,
                law=message.law,
                command=message.command,
                stamp=message.stamp,
                received_s=now_s,
            )

    @staticmethod
    def _confirm(session: _Session) -> None:
        """Note that the command held is the ground law's newest, which a beat after a lost event does not say."""
        newest, held = session.newest, session.held
        if newest is None or newest.flags & (UpFlags.BLIND | UpFlags.FAILED):
            return
        unused = not newest.flags & UpFlags.FLYING  # on the ground no command is used, and none sent again
        if unused or newest.number == (0 if held is None else held.number):
            session.seen_s = max(session.seen_s, session.newest_sent_s)

    def use(self, now_s: float) -> HeldCommand | None:
        """Return the newest command at the begin of a control cycle, when it is put to use; None before the first."""
        s = self._session
        if s is None:
            return None
        if s.newest is not None and s.clock is not None and s.newest.sequence != s.used:
            s.used = s.newest.sequence
            self._used_ages.note(now_s, seconds_between(ticks_of(now_s), s.newest.stamp + s.clock.offset))
        return s.held

    def status(self, now_s: float) -> LinkStatus:
        """Return the state of the link now."""
        session = self._session
        lately = now_s - self._rival_s < 1.0
        around = replace(
            NO_LINK,
            foreign=self._foreign.sum(now_s),
            foreign_from=self._foreign_from,
            rival=self._rival if lately else "",
            refused=self._refused,
        )
        if session is None:
            return around
        flags = session.newest.flags if session.newest is not None else UpFlags(0)
        return replace(
            around,
            connected=True,
            law=session.who.law,
            host=session.who.host,
            session=session.number,
            round_trip_s=nan if session.clock is None else session.clock.round_trip * TICK_S,
            silence_s=now_s - session.seen_s,
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
        s = self._session
        if s is None:
            return UpCounts()
        return UpCounts(
            messages=s.window.newest,
            events=s.events,
            again=0 if s.clock is None else s.clock.again,
            sent_bytes=0 if s.clock is None else s.clock.sent_bytes,
            received=s.received,
            received_bytes=s.received_bytes,
        )

    @property
    def sent(self) -> int:
        """Messages sent to the ground law in this session."""
        return 0 if self._session is None else self._session.sent

    @property
    def times(self) -> LinkTimes:
        """Clocks and newest messages of the session."""
        s = self._session
        if s is None or s.newest is None:
            return LinkTimes()
        held = s.held
        return LinkTimes(
            session=s.number,
            clock_offset_s=offset_s_of(s.clock),
            message=times_of(s.newest.stamp, s.newest_s, s.clock),
            command=MessageTimes() if held is None else times_of(held.stamp, held.received_s, s.clock),
            capture_ago_s=nan if held is None else held.command.capture_ago * TICK_S,
        )

    def report(self, shown: Shown, now_s: float) -> bytes | None:
        """Return a report to the ground law; None without a session."""
        session = self._session
        if session is None or session.newest is None:
            return None
        flags = DownFlags.AIRBORNE if shown.airborne else DownFlags(0)
        flags |= DownFlags.CUT if shown.cut else DownFlags(0)
        flags |= DownFlags.ARMING if shown.arming else DownFlags(0)
        median_s = self._used_ages.median_s
        self.unreported = False
        session.sent += 1
        report = Report(
            session=session.number,
            sequence=session.sent,
            stamp=ticks_of(now_s),
            echo=session.newest.stamp,
            held=short_ticks(now_s - session.newest_s),
            received=session.received,
            number=shown.number,
            epoch=shown.epoch,
            law=session.held.law if session.held is not None else 0,
            flags=flags,
            phase=shown.phase,
            up_age=short_ticks(median_s) if isfinite(median_s) else 0,
            q_w_flu_wxyz=shown.q_w_flu_wxyz,
            thrust=shown.thrust,
        )
        return self._sealed(session, report)

    def plan(self, plan: Plan) -> bytes | None:
        """Return a plan to the ground law; None without a session."""
        session = self._session
        if session is None:
            return None
        session.sent += 1
        return self._sealed(session, replace(plan, session=session.number, sequence=session.sent))

    def ask(self, text: str, now_s: float) -> None:
        """Ask the ground law for something, until it answers; an earlier question is dropped."""
        self._asks += 1
        self._asked = text, now_s - _LONG_AGO_S
        self.answers.clear()

    def rename(self, law: str) -> None:
        """Note that the ground flies another law."""
        if self._session is not None:
            self._session.who = replace(self._session.who, law=law)

    def stop_asking(self) -> None:
        """Drop the question that is still open."""
        self._asked = None

    def poll(self, now_s: float) -> bytes | None:
        """Return the open question when it is time to send it again; None otherwise."""
        session = self._session
        if self._asked is None or session is None or now_s - self._asked[1] < _ASK_AGAIN_S:
            return None
        text, _ = self._asked
        self._asked = text, now_s
        session.sent += 1
        ask = Text(kind=Kind.ASK, session=session.number, sequence=session.sent, nonce=self._ask_nonce(), text=text)
        return self._sealed(session, ask)

    def _ask_nonce(self) -> bytes:
        return self._asks.to_bytes(16, "little")

    def _sealed(self, session: _Session, message: MESSAGE) -> bytes:
        data = _down(session).sealed(packed(message))
        self.bytes_down += len(data)
        return data


def _down(session: _Session) -> Seal:
    return session.keys.down
