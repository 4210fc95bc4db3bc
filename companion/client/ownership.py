"""Commands of one client: which are under way, and whether the flight is its own. Pure."""

import math
from typing import Any

from companion.client.command_draft import CommandDraft
from companion.client.messages import Message
from companion.protocol.telemetry import ENDS, Answer, Reply, State

_BEGINS_A_FLIGHT = frozenset({"arm", "takeoff", "resume"})
"""Verbs after which a flight is this client's."""
_ENDS_A_FLIGHT = frozenset({"land", "abort", "disarm", "kill"})
"""Verbs that are done when the vehicle is disarmed."""
Fields = dict[str, Any]
"""A command: its verb and its fields."""

_HOLD, _ABORT = {"verb": "hold"}, {"verb": "abort"}
REMEDIES: dict[str, tuple[Fields, ...]] = {
    "arm": (_ABORT,),  # ends the checks before arming, too, which a disarm would not
    "takeoff": (_HOLD, _ABORT),  # no hold fits before it has left the ground; then the motors stop
    "goto": (_HOLD,),
    "track": (_HOLD,),
    "arms": ({"verb": "arms", "do": "hold"},),
}
"""Commands that end one under way safely, by its verb; the next one is for when one is rejected."""


class Ownership:
    """Record of what one client has begun on a vehicle."""

    def __init__(self) -> None:
        self._under_way: dict[str, str] = {}
        """Verbs by the ID of the command."""
        self._unanswered: set[str] = set()
        """Commands that begin a flight, without a reply so far."""
        self._flies = self._was_armed = False
        self._since_s = -math.inf
        """Time of the reply by which the flight began, by the service's clock: older states are of the time before."""

    @property
    def owns_flight(self) -> bool:
        """True from this client's arm, takeoff or resume until the vehicle is seen disarmed after it."""
        return self._flies or bool(self._unanswered)

    @property
    def any_under_way(self) -> bool:
        """True while a command of this client may be under way."""
        return bool(self._under_way)

    def begins(self, draft: CommandDraft) -> None:
        """Take a command that is about to be sent."""
        self._under_way[draft.id] = draft.verb
        if draft.verb in _BEGINS_A_FLIGHT:
            self._unanswered.add(draft.id)

    def is_not_sent(self, draft: CommandDraft) -> None:
        """Take back a command that certainly was not sent."""
        self._under_way.pop(draft.id, None)
        self._unanswered.discard(draft.id)

    def under_way(self, draft: CommandDraft) -> bool:
        """Return True if the command may be under way."""
        return draft.id in self._under_way

    def hear(self, message: Message) -> None:
        """Take a reply or a state of the service; ignore any other message."""
        if isinstance(message, Reply) and message.id in self._under_way:
            self._note_reply(message)
        elif isinstance(message, State) and message.time_s > self._since_s:
            if self._was_armed and not message.armed:
                self._flies = False
                self._unanswered.clear()
            self._was_armed = message.armed

    def _note_reply(self, reply: Reply) -> None:
        verb = self._under_way[reply.id]
        if reply.id in self._unanswered and reply.answer in {Answer.ACCEPTED, Answer.DONE}:
            if verb == "arm" or not self._flies:
                self._was_armed, self._since_s = False, reply.time_s
            self._flies = True
        self._unanswered.discard(reply.id)
        if verb == "arm" and reply.answer is Answer.FAILED and not self._was_armed:
            self._flies = False
        if verb in _ENDS_A_FLIGHT and reply.answer is Answer.DONE:
            self._flies = False  # the next state comes later
        if reply.answer in ENDS:
            del self._under_way[reply.id]

    def remedies(self, state: State) -> tuple[Fields, ...]:
        """Return the commands that end what this client has under way on a vehicle that is not its own."""
        doing = state.doing.verb if state.doing is not None and state.doing.id in self._under_way else ""
        if not doing and "arms" in self._under_way.values():
            doing = "arms"  # a state names the flight's command first
        return REMEDIES.get(doing, ())
