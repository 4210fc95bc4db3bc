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


class Voices(Protocol):
    """Output of a command to several vehicles."""

    def of(self, vehicle: str) -> Voice:
        """Return the output of one vehicle's part."""

    def end(self, code: int, text: str) -> None:
        """End the output of all; `text` sums up, or says why no vehicle was commanded."""


def line_of(message: Message, vehicle: str = "") -> str:
    """Return a received message as one JSON object, with its `type` added, and the vehicle's name if given."""
    if isinstance(message, Link):
        return _line("link", vehicle, {"there": message.there, "why": message.why})
    kind = next(name for model, name in _TYPES.items() if isinstance(message, model))
    assert isinstance(message, BaseModel)
    return _line(kind, vehicle, message.model_dump(mode="json"))


def end_line(code: int, text: str, vehicle: str = "") -> str:
    """Return the JSON object that ends a command, of one vehicle among several if `vehicle` is given."""
    return _line("end", vehicle, {"code": code, "text": text})


def _line(kind: str, vehicle: str, fields: dict[str, object]) -> str:
    return json.dumps({"type": kind, **fields, **({"vehicle": vehicle} if vehicle else {})})


class JsonVoice:
    """JSON output, one object a line: replies, then `end` with code and text."""

    def __init__(self, vehicle: str = "") -> None:
        """`vehicle`: name that each object gets; none where only one vehicle is commanded."""
        self._vehicle = vehicle

    def begin(self, verb: str) -> None:
        """Print nothing: JSON output has no live line."""

    def say(self, message: Message) -> None:
        """Print replies and connection changes; states would be ten a second."""
        if isinstance(message, Reply | Link):
            typer.echo(line_of(message, self._vehicle))

    def note(self, text: str) -> None:
        """Print the sentence as an object of type note."""
        typer.echo(_line("note", self._vehicle, {"text": text}))

    def end(self, code: int, text: str) -> None:
        """Print the object of type end, with the exit code."""
        typer.echo(end_line(code, text, self._vehicle))


class JsonVoices:
    """JSON output of several vehicles; the last `end` is of all, and names no vehicle."""

    def of(self, vehicle: str) -> Voice:
        """Return the output of one vehicle's part."""
        return JsonVoice(vehicle)

    def end(self, code: int, text: str) -> None:
        """Print the object of type end, with the exit code."""
        typer.echo(end_line(code, text))
