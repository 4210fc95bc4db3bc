"""Operator in the service's own process: its commands take the same way as those from the bus."""

import asyncio
import itertools
import json
import logging
import secrets
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from companion.adapters.broker.process import open_broker
from companion.adapters.mqtt.link import BusLink
from companion.adapters.system.background import background
from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.core.interfaces import FlightError, WatchdogTimer
from companion.core.types import OtherService
from companion.flight.sinks import FanOutSink
from companion.flight.tick import TickSink
from companion.protocol.commands import COMMAND, Command
from companion.protocol.telemetry import ENDS, Answer, Reply
from companion.records.record_process import RecordSink
from companion.service.about import about_of
from companion.service.command_job import SendReply
from companion.service.dispatcher import CommandDispatcher
from companion.service.flight_actions import FlightActions
from companion.service.publishing import STATE_S, CommandLogger, EventPublisher, StatePublisher
from companion.service.telemetry import Telemetry
from companion.service.vehicle_service import open_service
from companion.supervisor.without_frames import off_sentence

LOG = logging.getLogger(__name__)

_IDS = itertools.count(1)


def local_command(verb: str, **fields: object) -> Command:
    """Return a command of this process."""
    data = {"verb": verb, "id": f"local-{next(_IDS)}", "session": secrets.token_hex(8), "sent_s": 0.0, **fields}
    return COMMAND.validate_json(json.dumps(data))


class LocalOperator:
    """Sender of commands to the service in the same process, one after another."""

    service: FlightActions
    """Vehicle, once its devices are connected."""

    def __init__(self, take: Callable[[Command, SendReply], None], tell: Callable[[str], None]) -> None:
        self.take, self._tell = take, tell
        self.recorder: RecordSink | None = None
        """Recorder of the flight, whose file the state names."""

    async def do(self, verb: str, **fields: object) -> None:
        """Send a command by its verb; see `send`."""
        await self.send(local_command(verb, **fields))

    async def send(self, command: Command) -> None:
        """Wait until a command is complete; raise FlightError with the reason when it is rejected or fails."""
        ended: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()

        def hear(reply: Reply) -> None:
            if reply.answer is Answer.PROGRESS:
                self._tell(reply.text)
            elif reply.answer in ENDS and not ended.done():
                ended.set_result(reply)

        self.take(command, hear)
        reply = await ended
        if reply.answer is not Answer.DONE:
            raise FlightError(reply.sentence(command.verb))


class _LocalLink:
    """OperatorLink to an operator in this process, who is always there and has no rival."""

    def age_s(self) -> float:
        """Return 0 s."""
        return 0.0

    def others(self) -> tuple[OtherService, ...]:
        """Return none."""
        return ()

    def rival(self) -> str:
        """Return no conflict."""
        return ""


def _ignore(_: str) -> None:
    """Ignore the step that a command has reached, or the name of a law."""


@asynccontextmanager
async def open_local_operator(
    config: CompanionConfig,
    controller: LoadedController,
    sink: TickSink,
    watchdog_timer: WatchdogTimer,
    records: Path | None = None,
    tell: Callable[[str], None] = _ignore,
) -> AsyncIterator[LocalOperator]:
    """Open a service with an operator in this process, beside those on the bus where `[operator]` is configured.

    There the state and all events are published, as `companion serve` does; an embedded broker begins and ends with it.
    `tell` gets the steps that commands have reached. Raises like `open_service`.
    """
    async with AsyncExitStack() as stack:
        session, place = secrets.token_hex(8), config.operator
        if place is not None and place.embedded:
            await stack.enter_async_context(open_broker(place))
        bus = BusLink(place, MonotonicClock(), session, about_of(config, session)) if place is not None else None
        link = bus or _LocalLink()
        dispatcher = CommandDispatcher(config, _ignore, link.rival)
        operator = LocalOperator(dispatcher.take, tell)
        if bus is not None:
            publisher = EventPublisher(bus, None)
            operator.take = CommandLogger(dispatcher, publisher)
            await stack.enter_async_context(bus.listening(operator.take))
            states = StatePublisher(
                link=bus,
                telemetry=Telemetry(session, publisher),
                dispatcher=dispatcher,
                rate_hz=config.control.rate_hz,
                off="" if config.law.onboard_mocap else off_sentence(),
            )
            sink = FanOutSink([sink, states.telemetry])
            await stack.enter_async_context(background(_publish(states, operator), "companion.state"))
        operator.service = await stack.enter_async_context(
            open_service(config, controller, sink, watchdog_timer, link, records)
        )
        await stack.enter_async_context(dispatcher.serving(operator.service))
        yield operator


async def _publish(states: StatePublisher, operator: LocalOperator) -> None:
    """Publish the state ten times a second until cancelled."""
    while True:
        try:
            states.publish(operator.recorder)
        except Exception:
            LOG.exception("the state cannot be published")
        await asyncio.sleep(STATE_S)
