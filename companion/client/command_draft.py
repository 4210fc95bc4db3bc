"""Commands before they are sent, validated by the service's own models."""

import json
import secrets
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from companion.core.errors import ConfigError
from companion.core.validation_messages import plain
from companion.protocol.commands import COMMAND, STOPS


def stops(verb: str, fields: Mapping[str, object]) -> bool:
    """Return whether a command makes safe: sent to every vehicle that is reached, and late rather than never."""
    return verb in STOPS or fields.get("do") == "hold"


class CommandDraft:
    """Command without session and time; raises ConfigError with one sentence when the service would not accept it."""

    def __init__(self, verb: str, **fields: object) -> None:
        self.verb = verb
        self.id = secrets.token_hex(8)
        self._fields = {name: value for name, value in fields.items() if value is not None}
        try:
            self.payload("0" * 16, 0.0, "nobody")
        except ValidationError as error:
            raise ConfigError(_sentence(verb, error)) from error

    @property
    def stops(self) -> bool:
        """True for a command that makes safe."""
        return stops(self.verb, self._fields)

    def payload(self, session: str, sent_s: float, reply_to: str) -> bytes:
        """Return the JSON of the command, UTF-8."""
        header: dict[str, Any] = {
            "verb": self.verb,
            "id": self.id,
            "session": session,
            "sent_s": sent_s,
            "reply_to": reply_to,
        }
        return COMMAND.validate_json(json.dumps(header | self._fields)).model_dump_json(exclude_none=True).encode()


def _sentence(verb: str, error: ValidationError) -> str:
    detail = error.errors(include_url=False)[0]
    path = [str(part) for part in detail["loc"][1:]]
    reason = plain(detail)
    return f"{verb}: {'.'.join(path)} = {detail['input']!r}: {reason}" if path else f"{verb}: {reason}"
