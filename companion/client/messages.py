"""Messages that an operator's client hears."""

from dataclasses import dataclass

from companion.protocol.telemetry import Happened, Presence, Reply, State


@dataclass(frozen=True)
class Link:
    """Event: the connection to the broker broke or was restored."""

    there: bool
    why: str = ""


Message = Presence | State | Happened | Reply | Link
