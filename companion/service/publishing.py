"""Publication on the bus: the vehicle's state ten times a second, every command, reply and event at once."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from companion.adapters.mqtt.link import BusLink
from companion.protocol.commands import Command
from companion.protocol.telemetry import Answer, Happened, Kind, Reply, State
from companion.records.record_process import RecordSink
from companion.service.command_job import SendReply
from companion.service.dispatcher import CommandDispatcher
from companion.service.telemetry import Telemetry

STATE_S = 0.1
"""Period of the states."""
_NOT_PUBLISHED = {"id", "session", "sent_s", "reply_to", "verb", "waypoints"}


@dataclass(frozen=True, kw_only=True)
class StatePublisher:
    """Publisher of the vehicle's state."""

    link: BusLink
    telemetry: Telemetry
    dispatcher: CommandDispatcher
    rate_hz: float
    """Rate of the control loop."""
    off: str = ""
    """Sentence about checks that are off for good; empty when none is."""

    def publish(self, recorder: RecordSink | None) -> State:
        """Publish the state of now, and return it."""
        self.telemetry.warn(self.warnings(recorder))
        self.telemetry.record = Path(recorder.file).name if recorder is not None else ""
        ended = self.dispatcher.ended_loop
        if ended is not None:
            self.telemetry.note_ended_loop(*ended, time.monotonic())
        state = self.telemetry.state(self.dispatcher.doing, self.rate_hz)
        self.link.show(state)
        return state

    def warnings(self, recorder: RecordSink | None) -> tuple[str, ...]:
        """Return warnings that do not concern the flight: the record, a second service, and what is off for good."""
        unrecorded = f"the record: {recorder.failed}" if recorder is not None and recorder.failed else ""
        return tuple(filter(None, (unrecorded, self.link.rival(), self.off)))


class CommandLogger:
    """Wrapper of the dispatcher that publishes and records every command and reply."""

    def __init__(self, dispatcher: CommandDispatcher, publish: Callable[[Happened], None]) -> None:
        self._dispatcher, self._publish = dispatcher, publish

    def __call__(self, command: Command, say: SendReply) -> None:
        """Publish one command and pass it to the dispatcher."""

        def said(reply: Reply) -> None:
            if reply.answer is not Answer.PROGRESS:
                publish(Kind.REPLY, reply.text, f"{command.verb} {reply.answer}")
            say(reply)

        def publish(kind: Kind, text: str, name: str) -> None:
            self._publish(Happened(time_s=time.time(), kind=kind, text=text, name=name, id=command.id))

        fields = command.model_dump(exclude=_NOT_PUBLISHED, exclude_none=True)
        publish(Kind.COMMAND, " ".join(f"{name}={value}" for name, value in fields.items()), command.verb)
        self._dispatcher.take(command, said)


class EventPublisher:
    """Publisher of events to the operators and into the record."""

    def __init__(self, link: BusLink, recorder: RecordSink | None) -> None:
        self._link, self._recorder = link, recorder

    def __call__(self, happened: Happened) -> None:
        """Publish one event and record it."""
        self._link.tell(happened)
        if self._recorder is not None:
            text = happened.text
            if happened.kind is Kind.REPLY:
                text = f"{happened.name}: {text}" if text else happened.name
            elif happened.kind is Kind.COMMAND:
                text = f"{happened.name} {text}".rstrip()
            self._recorder.tell(str(happened.kind), text, time.monotonic())
