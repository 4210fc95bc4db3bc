"""The interface of a command's output, and its JSON form for scripts."""

import json
from typing import Protocol

import typer
from pydantic import BaseModel

from companion.client.messages import Link, Message
from companion.protocol.telemetry import Happened, Presence, Reply, State

_TYPES: dict[type, str] = {Reply: "reply", State: "state", Happened: "event", Presence: "status"}


class Voice(Protocol):
    """Output of a command while it runs and at its end."""

    def begin(self, verb: str) -> None:
        """Start to show that `verb` is being waited for."""

    def say(self, message: Message) -> None:
        """Print a message from the service if it matters to the user."""

    def note(self, text: str) -> None:
        """Print a sentence that does not come from the service."""

    def end(self, code: int, text: str) -> None:
        """Print the last sentence; `code` is the exit code."""


def line_of(message: Message) -> str:
    """Return a received message as one JSON object, with its `type` added."""
    if isinstance(message, Link):
        return json.dumps({"type": "link", "there": message.there, "why": message.why})
    kind = next(name for model, name in _TYPES.items() if isinstance(message, model))
    assert isinstance(message, BaseModel)
    return json.dumps({"type": kind, **message.model_dump(mode="json")})


class JsonVoice:
    """JSON output, one object a line: replies, then `end` with code and text."""

    def begin(self, verb: str) -> None:
        """Print nothing: JSON output has no live line."""

    def say(self, message: Message) -> None:
        """Print replies and connection changes; states would be ten a second."""
        if isinstance(message, Reply | Link):
            typer.echo(line_of(message))

    def note(self, text: str) -> None:
        """Print the sentence as an object of type note."""
        typer.echo(json.dumps({"type": "note", "text": text}))

    def end(self, code: int, text: str) -> None:
        """Print the object of type end, with the exit code."""
        typer.echo(json.dumps({"type": "end", "code": code, "text": text}))
