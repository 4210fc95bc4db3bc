"""One command of an operator, from sending to its end."""

import asyncio
import math
from collections.abc import AsyncGenerator
from enum import Enum

from companion.client.broker_connection import NotSentError
from companion.client.client import Console
from companion.client.command_draft import CommandDraft
from companion.client.errors import NoServiceError, TimedOutError, UnknownOutcomeError
from companion.client.messages import Link, Message
from companion.protocol.telemetry import ENDS, Answer, Reply, State

_ANSWER_S = 8.0
"""Time to wait for an answer: the service replies at once, or after its checks of a trajectory."""
_LATE_S = 2.0
"""Time after which a command that stops nothing is not sent any more: nobody expects the motion by then."""
_GONE_S = 15.0
"""Time without broker or service after which the end of a command counts as lost."""
_UNSEEN_S = 2.0
"""Time to wait for a reply after a broken connection, and after the state shows that the command ended."""
_AT_ONCE_S = 15.0
"""Longest duration of a command that no state shows while it is under way, such as hold and resume."""
_LOOK_S = 0.2
_NOT_FLYING = frozenset({"standby", "disarmed"})
"""Phases in which the service does not fly."""
_ENDS_DISARMED = frozenset({"land", "abort", "kill", "disarm"})


def armed_of(state: State) -> str:
    """Return the arming state in words: the autopilot may be about to disarm, or armed by its pilot."""
    if state.armed and state.phase in _NOT_FLYING:
        return "the autopilot is armed, although the service flies nothing"
    return "armed" if state.armed else "disarmed"


def known_of(console: Console) -> str:
    """Return the newest knowledge of the vehicle as part of a sentence."""
    state = console.state
    if state is None:
        return "nothing is known of the vehicle"
    age_s = console.state_age_s()
    when = "now" if age_s < 1.0 else f"{age_s:.0f} s ago"
    place = "" if state.position_w_m is None else f", {state.position_w_m[2]:.2f} m high"
    return f"{when}: phase {state.phase}, {armed_of(state)}{place}"


class Sent(Enum):
    """Knowledge of whether the command reached the broker."""

    NO = "nothing was sent"
    PERHAPS = "it may have been sent"
    YES = "it was sent"


class PendingCommand:
    """Command under way; `messages` yields every message until the reply that ends it."""

    def __init__(self, console: Console, draft: CommandDraft, timeout_s: float = math.inf) -> None:
        self._console, self._draft, self._timeout_s = console, draft, timeout_s
        self.sent = Sent.NO
        self.accepted = False
        self._session = ""
        self._begun_s = self._heard_s = self._restored_s = 0.0
        self._broke = False
        """True when the connection broke after sending: the final reply may have been missed."""
        self._ended_s = math.inf
        """Instant from which the states show that it is not under way any more."""
        self._seen_in_state = False
        """True once a state has shown it under way."""

    async def messages(self) -> AsyncGenerator[Message, None]:
        """Send the command and yield every message until the reply that ends it.

        Raises NoServiceError when no service was found and nothing was sent, TimedOutError after the timeout,
        UnknownOutcomeError when the end is not known, ConfigError when the broker rejects commands of this user.
        """
        with self._console.inbox() as inbox:
            await self._send()
            loop = asyncio.get_running_loop()
            self._begun_s = self._heard_s = loop.time()
            while True:
                message = await inbox.next(_LOOK_S)
                if message is not None and not self._is_of_another(message):
                    self._note(message, loop.time())
                    yield message
                    if isinstance(message, Reply) and message.id == self._draft.id and message.answer in ENDS:
                        return
                self._expect_reply(loop.time())

    def _expect_reply(self, now_s: float) -> None:
        """Raise the error that says why the final reply will not arrive, or is not waited for."""
        if now_s - self._begun_s > self._timeout_s:
            over = f"not over after {self._timeout_s:g} s; it goes on"
            raise TimedOutError(f"{self._draft.verb}: {over}; {known_of(self._console)}")
        why = self._loss(now_s)
        if why:
            raise UnknownOutcomeError(f"{self._draft.verb}: {why}; {known_of(self._console)}")

    async def _send(self) -> None:
        """Send the command once; retry only while it certainly was not sent, and for longer if it stops something."""
        now_s = asyncio.get_running_loop().time
        patience_s = _ANSWER_S if self._draft.stops else _LATE_S
        end_s, whole = now_s() + patience_s, True
        while True:
            whole = whole and self._console.linked
            state = await self._found(end_s)
            if not whole and now_s() > end_s:
                broken = f"the connection was broken for more than {patience_s:g} s"
                raise NoServiceError(f"{self._draft.verb}: nothing was sent: {broken}; give the command again")
            if state is not None and await self._was_sent(state):
                return
            whole = False

    async def _found(self, end_s: float) -> State | None:
        """Return the service's state; None when the connection broke and there is time left, else NoServiceError."""
        try:
            return await self._console.find()
        except NoServiceError:
            if self._console.linked or asyncio.get_running_loop().time() > end_s:
                raise
        return None

    async def _was_sent(self, state: State) -> bool:
        """Send it to the service of this state; return False, after a while, when it certainly was not sent."""
        self._session = state.session
        self.sent = Sent.PERHAPS
        try:
            if await self._console.send(self._draft):
                self.sent = Sent.YES
        except NotSentError:
            self.sent = Sent.NO
            await asyncio.sleep(_LOOK_S)
        return self.sent is not Sent.NO

    def _is_of_another(self, message: Message) -> bool:
        """Return whether it is the reply of a second service that was not addressed."""
        return isinstance(message, Reply) and message.session not in {"", self._session}

    def _note(self, message: Message, now_s: float) -> None:
        if isinstance(message, Link):
            self._broke, self._restored_s = True, now_s
        elif isinstance(message, State) and message.session == self._session:
            self._heard_s = now_s
            self._seen_in_state = self._seen_in_state or (
                message.doing is not None and message.doing.id == self._draft.id
            )
        elif isinstance(message, Reply) and message.id == self._draft.id:
            self._heard_s, self.sent = now_s, Sent.YES
            self.accepted = self.accepted or message.answer is not Answer.REFUSED

    def _loss(self, now_s: float) -> str:
        """Return why the final reply will not arrive; empty while it may."""
        if self._console.replaced(self._session):
            return "the service was restarted meanwhile, and it is not known how this ended"
        if now_s - self._heard_s > _GONE_S:
            who = "the service is" if self._console.linked else "the broker is"
            return f"{who} not heard any more for {_GONE_S:g} s, and it is not known how this ends"
        return self._loss_while_connected(now_s) if self._console.linked else ""

    def _loss_while_connected(self, now_s: float) -> str:
        """Return why the final reply will not arrive although there is a connection; empty while it may."""
        if not self.accepted and now_s - max(self._begun_s, self._restored_s) > _ANSWER_S:
            return f"no answer within {_ANSWER_S:g} s, {self._delivery()}"
        if not self.accepted or not self._has_ended():
            self._ended_s = math.inf
            return ""
        if self._broke and now_s - self._restored_s > _UNSEEN_S:
            return "it ended while the connection was broken, and it is not known how"
        self._ended_s = min(self._ended_s, now_s)
        shown = self._seen_in_state or self._draft.verb in _ENDS_DISARMED
        if now_s - self._ended_s > (_UNSEEN_S if shown else _AT_ONCE_S):
            return "it is not carried out any more, and how it ended was not heard"
        return ""

    def _delivery(self) -> str:
        if self.sent is Sent.PERHAPS:
            return "and it is not known whether it has reached the service, because the connection broke just then"
        return "although the broker has it: does the broker let this user command, and the service read it?"

    def _has_ended(self) -> bool:
        """Return whether the newest state shows that the command is not under way any more."""
        state = self._console.state
        if state is None or self._console.state_age_s() > _UNSEEN_S:
            return False
        if self._draft.verb in _ENDS_DISARMED:
            return not state.armed
        if state.doing is None:
            return True
        hidden = self._draft.verb == "arms" and state.doing.verb != "arms"  # a state names the flight's command first
        return not hidden and state.doing.id != self._draft.id
