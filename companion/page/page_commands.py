"""Reading of a page's messages: each becomes a command, a question whether to kill, or a sentence why not."""

import hmac
import secrets
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from pydantic_core import from_json

from companion.client.command_draft import CommandDraft
from companion.core.errors import ConfigError
from companion.protocol.commands import VERBS

MOST_BYTES = 8192
"""Largest message of a page."""
AFTER_S, UNTIL_S = 1.5, 10.0
"""Time between asking for a kill and confirming it: least, and largest."""
_MOST_REF = 2**53 - 1
"""Largest whole number that JavaScript keeps exactly."""
_MOST_FIELDS = 32
_TEXT = 200
_OURS = frozenset({"type", "ref", "vehicle", "verb", "nonce"})
_NOT_THE_PAGES = frozenset({"id", "session", "sent_s", "reply_to", "waypoints"})


@dataclass(frozen=True)
class Order:
    """Command to send."""

    ref: int
    vehicle: str
    draft: CommandDraft


@dataclass(frozen=True)
class Question:
    """Request for a kill, to be confirmed with a nonce."""

    ref: int
    vehicle: str
    nonce: str


class NotAcceptedError(Exception):
    """Message that is not accepted; `ref` where it could be read."""

    def __init__(self, ref: int | None, text: str) -> None:
        super().__init__(text[:_TEXT])
        self.ref = ref


@dataclass
class PageCommands:
    """Reader of one connection's messages. A message that comes a second time is refused by its `ref`."""

    ref: int = 0
    """Largest number so far; the next must be larger."""
    _kill: tuple[str, str, float] | None = field(default=None, init=False)
    """Vehicle, nonce and time of the newest question; used once."""

    def take(self, text: str, vehicles: Collection[str], can_command: bool, now_s: float) -> Order | Question:
        """Return what a message asks for; raise NotAcceptedError with a sentence. `now_s` is monotonic."""
        fields = _fields(text)
        ref = self._next_ref(fields)
        if not can_command:
            raise NotAcceptedError(ref, "this page only looks: log in to command")
        vehicle, verb = fields.get("vehicle"), fields.get("verb")
        if not isinstance(vehicle, str) or vehicle not in vehicles:
            raise NotAcceptedError(ref, "there is no vehicle of this name")
        if not isinstance(verb, str) or verb not in VERBS:
            raise NotAcceptedError(ref, f"verb: must be one of {', '.join(VERBS)}")
        wrong = sorted(_NOT_THE_PAGES & fields.keys())
        if wrong:
            raise NotAcceptedError(ref, f"{wrong[0]}: a page does not give this")
        if verb == "kill" and fields.keys() <= _OURS - {"nonce"}:
            return self._ask(ref, vehicle, now_s)
        if verb == "kill":
            self._confirm(ref, fields, now_s)
        elif "nonce" in fields:
            raise NotAcceptedError(ref, "nonce: only a kill has one")
        try:
            draft = CommandDraft(verb, **{name: value for name, value in fields.items() if name not in _OURS})
        except ConfigError as error:
            raise NotAcceptedError(ref, str(error)) from error
        return Order(ref, vehicle, draft)

    def _next_ref(self, fields: dict[str, Any]) -> int:
        if fields.get("type") != "command":
            raise NotAcceptedError(None, "type: must be command")
        ref = fields.get("ref")
        if type(ref) is not int or not 1 <= ref <= _MOST_REF:
            raise NotAcceptedError(None, "ref: must be a whole number from 1 on")
        if ref <= self.ref:
            raise NotAcceptedError(ref, f"ref: must be larger than {self.ref}, the last one: this is a repetition")
        self.ref = ref
        return ref

    def _ask(self, ref: int, vehicle: str, now_s: float) -> Question:
        nonce = secrets.token_urlsafe(16)
        self._kill = (vehicle, nonce, now_s)
        return Question(ref, vehicle, nonce)

    def _confirm(self, ref: int, fields: dict[str, Any], now_s: float) -> None:
        """Accept the confirmation of the newest question once, and in its time; raise NotAcceptedError."""
        asked, self._kill = self._kill, None
        nonce = fields.get("nonce")
        if asked is None or not isinstance(nonce, str):
            raise NotAcceptedError(ref, "kill: ask for it first, then confirm with the nonce")
        vehicle, expected, asked_s = asked
        if vehicle != fields["vehicle"] or not hmac.compare_digest(expected.encode(), nonce.encode()):
            raise NotAcceptedError(ref, "kill: this is not the nonce of the newest question")
        if not AFTER_S <= now_s - asked_s <= UNTIL_S:
            raise NotAcceptedError(ref, f"kill: confirm after {AFTER_S:g} s and before {UNTIL_S:g} s")


def _fields(text: str) -> dict[str, Any]:
    if len(text.encode(errors="replace")) > MOST_BYTES:
        raise NotAcceptedError(None, f"a message has at most {MOST_BYTES} bytes")
    try:
        read = from_json(text, allow_inf_nan=False)
    except ValueError:
        raise NotAcceptedError(None, "not JSON") from None
    if not isinstance(read, dict) or len(read) > _MOST_FIELDS:
        raise NotAcceptedError(None, "a message is one JSON object of a few fields")
    return read
