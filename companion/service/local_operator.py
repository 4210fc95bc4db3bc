"""Operator in the service's own process: its commands take the same way as those from the bus."""

import asyncio
import itertools
import json
import secrets
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

from companion.adapters.mqtt.link import BusLink
from companion.adapters.system.clock import MonotonicClock
from companion.config.companion_config import CompanionConfig
from companion.config.controller_config import LoadedController
from companion.core.interfaces import FlightError, WatchdogTimer
from companion.core.types import OtherService
from companion.flight.tick import TickSink
from companion.protocol.commands import COMMAND, Command
from companion.protocol.telemetry import ENDS, Answer, Reply
from companion.service.dispatcher import CommandDispatcher
from companion.service.flight_actions import FlightActions
from companion.service.vehicle_service import open_service

_IDS = itertools.count(1)


def local_command(verb: str, **fields: object) -> Command:
    """Return a command of this process."""
    data = {"verb": verb, "id": f"local-{next(_IDS)}", "session": secrets.token_hex(8), "sent_s": 0.0, **fields}
    return COMMAND.validate_json(json.dumps(data))


class LocalOperator:
    """Sender of commands to the service in the same process, one after another."""

    def __init__(self, service: FlightActions, dispatcher: CommandDispatcher, tell: Callable[[str], None]) -> None:
        self.service, self._dispatcher, self._tell = service, dispatcher, tell

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

        self._dispatcher.take(command, hear)
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

    `tell` gets the steps that commands have reached. Raises like `open_service`.
    """
    async with AsyncExitStack() as stack:
        bus = BusLink(config.operator, MonotonicClock(), secrets.token_hex(8)) if config.operator else None
        link = bus or _LocalLink()
        dispatcher = CommandDispatcher(config, _ignore, link.rival)
        if bus is not None:
            await stack.enter_async_context(bus.listening(dispatcher.take))
        service = await stack.enter_async_context(open_service(config, controller, sink, watchdog_timer, link, records))
        await stack.enter_async_context(dispatcher.serving(service))
        yield LocalOperator(service, dispatcher, tell)
