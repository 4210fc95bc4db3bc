"""What a command says while it is carried out; and as JSON, for scripts."""

import json
from typing import Protocol

import typer
from pydantic import BaseModel

from companion.client.client import Link, Said
from companion.protocol.telemetry import Happened, Presence, Reply, State

_TYPES: dict[type, str] = {Reply: "reply", State: "state", Happened: "event", Presence: "status"}


class Voice(Protocol):
    """What a command says while it is carried out, and at its end."""

    def begin(self, verb: str) -> None:
        """From now on there is something to wait for."""

    def say(self, said: Said) -> None:
        """Of what is heard, all that is worth telling."""

    def note(self, text: str) -> None:
        """A sentence of our own."""

    def end(self, code: int, text: str) -> None:
        """The last sentence."""


def line_of(said: Said) -> str:
    """One JSON object: the message as it came, and `type`."""
    if isinstance(said, Link):
        return json.dumps({"type": "link", "there": said.there, "why": said.why})
    kind = next(name for model, name in _TYPES.items() if isinstance(said, model))
    assert isinstance(said, BaseModel)
    return json.dumps({"type": kind, **said.model_dump(mode="json")})


class JsonVoice:
    """One object a line: replies, and at last `end` with code and text."""

    def begin(self, verb: str) -> None:
        """Nothing."""

    def say(self, said: Said) -> None:
        """Replies and the connection; states would be ten a second."""
        if isinstance(said, Reply | Link):
            typer.echo(line_of(said))

    def note(self, text: str) -> None:
        """As an object of its own."""
        typer.echo(json.dumps({"type": "note", "text": text}))

    def end(self, code: int, text: str) -> None:
        """`code` is the exit code."""
        typer.echo(json.dumps({"type": "end", "code": code, "text": text}))
