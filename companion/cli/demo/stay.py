"""After the demo's own flight: its report, and then the vehicle stays on the page until Ctrl-C."""

import asyncio
import signal
from collections.abc import Awaitable, Callable
from contextlib import suppress

from companion.core.interfaces import CompanionError
from companion.flight.tick import Tick, TickSink
from companion.service.flight_actions import FlightActions
from companion.supervisor.flight_state import STREAMING, Phase


class Gate:
    """TickSink that passes ticks on while it is open."""

    def __init__(self, sink: TickSink) -> None:
        self.sink: TickSink | None = sink
        """Receiver of the ticks; None: closed."""

    def __call__(self, tick: Tick) -> None:
        """Pass a tick on."""
        if self.sink is not None:
            self.sink(tick)


async def stay(service: FlightActions, for_s: float, report: Callable[[], Awaitable[None]]) -> None:
    """Report the flight, then serve the vehicle for a time or until Ctrl-C; then land what flies."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, stop.set)
    await report()
    waiting = {service.ticking, asyncio.create_task(stop.wait(), name="companion.stay")}
    try:
        await asyncio.wait(
            waiting, timeout=None if for_s == float("inf") else for_s, return_when=asyncio.FIRST_COMPLETED
        )
    finally:
        waiting.discard(service.ticking)
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
    if service.phase in STREAMING | {Phase.HANDED_OVER}:
        with suppress(CompanionError):  # the page has shown why
            await service.land()
