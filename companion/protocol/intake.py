"""Which bytes are a command that counts."""

import re
from dataclasses import dataclass

from pydantic import ValidationError
from pydantic_core import from_json

from companion.core.validation_messages import plain
from companion.protocol.commands import COMMAND, ID, VERBS, Command
from companion.protocol.topics import is_client

MAX_BYTES = 48_000
"""400 waypoints have less."""
STALE_S = 5.0
"""A command is for now: one that lay in a queue for longer was meant for another moment."""
_MOST_FIELDS = 32
_REASON_CHARACTERS = 200
_MOST_IDS = 100_000
"""More than anybody commands in one run of the service; then it takes no more but abort and kill."""


@dataclass(frozen=True)
class Refusal:
    """Bytes that are no command that counts."""

    reason: str
    """A sentence without its full stop."""
    id: str = ""
    """As in the command; empty when it could not be read."""
    reply_to: str | None = None


class Intake:
    """Tells commands from all else, for one run of the service.

    What was recorded off the network and sent again is refused: in the same run by its id, in another by its session.
    """

    def __init__(self, session: str) -> None:
        self._session = session
        self._taken: set[str] = set()

    def take(self, payload: bytes, now_s: float) -> Command | Refusal:
        """The command in `payload`, or why there is none; `now_s` is Unix time. Each id is taken once."""
        if len(payload) > MAX_BYTES:
            return Refusal(f"{len(payload)} bytes are no command: at most {MAX_BYTES}")
        fields = _fields(payload)
        if len(fields) > _MOST_FIELDS:  # each would be a mistake to tell of, which takes time
            return self.refuse(payload, f"{len(fields)} fields are no command: at most {_MOST_FIELDS}")
        try:
            read = COMMAND.validate_json(payload)
        except ValidationError as error:
            return self.refuse(payload, _reason(error))
        reason = self._objection(read, now_s)
        if reason:
            return Refusal(reason, read.id, read.reply_to)
        self._taken.add(read.id)
        return read

    def refuse(self, payload: bytes, reason: str) -> Refusal:
        """For `reason`; with id and client, so far as they can be read, that the sender may know what is meant."""
        fields = _fields(payload) if len(payload) <= MAX_BYTES else {}
        name, client = fields.get("id"), fields.get("reply_to")
        return Refusal(
            reason,
            name if isinstance(name, str) and re.fullmatch(ID, name) else "",
            client if isinstance(client, str) and is_client(client) else None,
        )

    def _objection(self, read: Command, now_s: float) -> str:
        if read.session != self._session:
            return "meant for another run of the service: read the session in its status again"
        age_s = now_s - read.sent_s
        if abs(age_s) > STALE_S:
            when = f"{age_s:.1f} s ago" if age_s > 0.0 else f"{-age_s:.1f} s in the future"
            return f"sent {when} by the service's clock, at most {STALE_S:g} s count"
        if read.id in self._taken:
            return "this id was taken already"
        if len(self._taken) >= _MOST_IDS and read.verb not in {"abort", "kill"}:
            return "too many commands for one run of the service: restart it on the ground"
        return ""


def _fields(payload: bytes) -> dict[str, object]:
    """Of what may be no command otherwise; none when it is no JSON object."""
    try:
        read = from_json(payload)
    except ValueError:
        return {}
    return read if isinstance(read, dict) else {}


def _reason(error: ValidationError) -> str:
    """The first mistake, cut short: its text may hold what the sender wrote."""
    detail = error.errors(include_url=False, include_input=False)[0]
    if detail["type"] in {"union_tag_not_found", "union_tag_invalid"}:
        return f"verb: must be one of {', '.join(VERBS)}"
    where = ".".join(str(part) for part in detail["loc"][1:])
    said = plain(detail)
    return (f"{where}: {said}" if where else said)[:_REASON_CHARACTERS]
