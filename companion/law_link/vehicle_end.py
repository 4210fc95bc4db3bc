"""Vehicle's end of the law's link: one ground law at a time, its newest command, and reports to it. Pure.

A session begins only while no flight is on, so that a ground law that comes back, or a second one, never takes over in
the air. Datagrams that are not of the session are counted and dropped, whatever they contain.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite

from companion.law_link.agreement import Introduction, Refusal, difference, introduction_of
from companion.law_link.codec import packed, unpacked
from companion.law_link.link_status import NO_LINK, LinkStatus, SecondCount, UpCounts
from companion.law_link.link_times import LinkTimes
from companion.law_link.messages import (
    MESSAGE,
    BadMessageError,
    DownFlags,
    Kind,
    Plan,
    Pose,
    Report,
    Text,
    UpMessage,
    short_ticks,
    ticks_of,
)
from companion.law_link.sealing import hello_seal, session_keys
from companion.law_link.vehicle_session import HeldCommand, VehicleSession

Random = Callable[[int], bytes]
"""Returns this many random bytes."""
_ASK_AGAIN_S = 0.1
_REPLY_S = 0.2
"""Shortest time between two replies to hellos: nobody is answered more often than it helps."""
_LONG_AGO_S = 6.0


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


class VehicleEnd:
    """Sessions, and what came in them. Feed it datagrams with `hear`; `report`, `plan` and `poll` return others."""

    def __init__(self, secret: bytes, me: Introduction, random: Random) -> None:
        self._secret, self._me, self._random = secret, me, random
        self._hello = hello_seal(secret)
        self._session: VehicleSession | None = None
        self._pending: VehicleSession | None = None
        """Session that was offered; it begins with the first message that proves its key."""
        self.locked = False
        """True while a flight is on: no session begins."""
        self._foreign = SecondCount()
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
        differs = difference(self._me, who)
        if differs:
            return Refusal(differs)
        if self.locked:
            why = "a flight is on: a ground law may begin only while the vehicle stands disarmed, or is landed"
            return Refusal(why, passes=True)
        return None

    def _heard_lately(self, now_s: float) -> bool:
        return self._session is not None and now_s - self._session.newest_s < 1.0

    def _welcome(self, ground_nonce: bytes, who: Introduction) -> bytes:
        vehicle_nonce = self._random(16)
        number = int.from_bytes(self._random(2), "little") or 1  # records take 0 for none
        keys = session_keys(self._secret, ground_nonce, vehicle_nonce)
        self._pending = VehicleSession(number, keys, ground_nonce, who)
        welcome = Text(
            kind=Kind.WELCOME,
            session=number,
            nonce=ground_nonce,
            vehicle_nonce=vehicle_nonce,
            text=json.dumps({"vehicle": self._me.host}),
        )
        return self._hello.sealed(packed(welcome))

    def _take(self, session: VehicleSession, data: bytes, size: int, now_s: float, source: str) -> None:
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
        if not session.take(message, size, now_s):
            self._note_foreign(now_s, source)
            return
        self._accepted += 1
        if isinstance(message, Text):
            self._take_answer(message)
        else:
            self.unreported |= message.command is not None

    def _take_answer(self, message: Text) -> None:
        if self._asked is not None and message.kind is Kind.ANSWER and message.nonce == self._ask_nonce():
            self._asked = None
            self.answers.append(message.text)

    def use(self, now_s: float) -> HeldCommand | None:
        """Return the newest command at the begin of a control cycle, when it is put to use; None before the first."""
        return None if self._session is None else self._session.use(now_s)

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
        return around if session is None else session.status(around, now_s)

    @property
    def counts(self) -> UpCounts:
        """Messages that the ground law has sent in this session."""
        return UpCounts() if self._session is None else self._session.counts

    @property
    def sent(self) -> int:
        """Messages sent to the ground law in this session."""
        return 0 if self._session is None else self._session.sent

    @property
    def times(self) -> LinkTimes:
        """Clocks and newest messages of the session."""
        return LinkTimes() if self._session is None else self._session.times

    def report(self, shown: Shown, now_s: float) -> bytes | None:
        """Return a report to the ground law; None without a session."""
        session = self._session
        if session is None or session.newest is None:
            return None
        flags = DownFlags.AIRBORNE if shown.airborne else DownFlags(0)
        flags |= DownFlags.CUT if shown.cut else DownFlags(0)
        flags |= DownFlags.ARMING if shown.arming else DownFlags(0)
        median_s = session.used_ages.median_s
        self.unreported = False
        session.sent += 1
        report = Report(
            session=session.number,
            sequence=session.sent,
            stamp=ticks_of(now_s),
            echo=session.newest.stamp,
            held=short_ticks(now_s - session.newest_s),
            received=session.counts.received,
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

    def _sealed(self, session: VehicleSession, message: MESSAGE) -> bytes:
        data = session.keys.down.sealed(packed(message))
        self.bytes_down += len(data)
        return data
