"""Validation of received commands: size, format, session, age, each ID once."""

import re
from dataclasses import dataclass

from pydantic import ValidationError
from pydantic_core import from_json

from companion.core.validation_messages import plain
from companion.protocol.commands import COMMAND, ID, VERBS, Command
from companion.protocol.topics import is_client

MAX_BYTES = 48_000
"""Largest size of a command; 400 waypoints need less."""
STALE_S = 5.0
"""Largest age of a command: one that waited in a queue for longer was meant for another moment."""
_MOST_FIELDS = 32
_REASON_CHARACTERS = 200
_MOST_IDS = 100_000
"""Largest number of commands in one run of the service; after that only abort and kill are accepted."""


@dataclass(frozen=True)
class Refusal:
    """Reason why received bytes are not accepted as a command."""

    reason: str
    """One sentence without its full stop."""
    id: str = ""
    """ID of the command; empty when it could not be read."""
    reply_to: str | None = None


class Intake:
    """Accepts or rejects received commands during one run of the service.

    A recorded command that is sent again is rejected: in the same run by its ID, in another run by its session.
    """

    def __init__(self, session: str) -> None:
        self._session = session
        self._taken: set[str] = set()

    def take(self, payload: bytes, now_s: float) -> Command | Refusal:
        """Return the command in `payload`, or why it is rejected; `now_s` is Unix time. Each ID is accepted once."""
        if len(payload) > MAX_BYTES:
            return Refusal(f"{len(payload)} bytes are no command: at most {MAX_BYTES}")
        fields = _fields(payload)
        if len(fields) > _MOST_FIELDS:  # pydantic would report each one, which takes time
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
        """Return a refusal with `reason`, and with the command's ID and client as far as they can be read."""
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
    """Return the fields of a payload that may not be a valid command; empty when it is no JSON object."""
    try:
        read = from_json(payload)
    except ValueError:
        return {}
    return read if isinstance(read, dict) else {}


def _reason(error: ValidationError) -> str:
    """Return the first error as text, truncated because it may contain what the sender wrote."""
    detail = error.errors(include_url=False, include_input=False)[0]
    if detail["type"] in {"union_tag_not_found", "union_tag_invalid"}:
        return f"verb: must be one of {', '.join(VERBS)}"
    where = ".".join(str(part) for part in detail["loc"][1:])
    said = plain(detail)
    return (f"{where}: {said}" if where else said)[:_REASON_CHARACTERS]
