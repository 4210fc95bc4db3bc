"""Told to end while the devices are looked for; what operators are told beside the vehicle's state."""

import asyncio
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import pytest

from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import AutopilotError, ConfigError
from companion.service import daemon
from companion.service.daemon import begun_unless
from companion.service.publishing import StatePublisher
from companion.supervisor.without_frames import off_sentence


class Doing:
    """Takes its time to begin, and then to end; closes what it opened."""

    def __init__(self) -> None:
        self.stop, self.begun, self.goes_on = asyncio.Event(), asyncio.Event(), asyncio.Event()
        self.closed = False

    async def run(self, *, begin: Callable[[], Awaitable[object]]) -> None:
        try:
            await begin()
            self.begun.set()
            await self.goes_on.wait()
        finally:
            await asyncio.sleep(0)
            self.closed = True


async def for_ever() -> None:
    await asyncio.Event().wait()


async def at_once() -> None:
    return


async def fails() -> None:
    raise AutopilotError("no autopilot heard")


async def test_who_is_told_to_end_does_not_wait_for_a_vehicle() -> None:
    doing = Doing()
    asyncio.get_running_loop().call_soon(doing.stop.set)
    async with asyncio.timeout(5.0):
        await begun_unless(doing.stop, doing.begun, doing.run(begin=for_ever))
    assert doing.closed


async def test_a_vehicle_that_is_there_lands_first() -> None:
    doing = Doing()
    running = asyncio.create_task(begun_unless(doing.stop, doing.begun, doing.run(begin=at_once)))
    await doing.begun.wait()
    doing.stop.set()
    for _ in range(10):
        await asyncio.sleep(0)
    assert not running.done()
    doing.goes_on.set()
    await running
    assert doing.closed


async def test_a_device_that_is_not_there_is_told() -> None:
    doing = Doing()
    with pytest.raises(AutopilotError):
        await begun_unless(doing.stop, doing.begun, doing.run(begin=fails))
    assert doing.closed


async def test_cancelled_from_outside_it_is_closed_in_order() -> None:
    doing = Doing()
    running = asyncio.create_task(begun_unless(doing.stop, doing.begun, doing.run(begin=for_ever)))
    await asyncio.sleep(0)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert doing.closed


async def test_a_setting_that_no_next_attempt_would_mend_ends_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as a port of the law's link that another service has; a device that is missing is sought again."""

    def opening(*_: Any) -> Any:
        raise ConfigError("law.link.port = 14600: cannot listen on 0.0.0.0")

    monkeypatch.setattr(daemon, "open_service", opening)
    settings: Any = SimpleNamespace(
        config=CompanionConfig(), controller=None, records=None, last_resort=SimpleNamespace(flying=bool)
    )
    nothing: Any = None
    with pytest.raises(ConfigError, match="cannot listen on"):
        async with asyncio.timeout(5.0):
            await daemon._serve_vehicles(settings, nothing, nothing, nothing, nothing, asyncio.Event())


def test_operators_are_told_when_a_flight_is_not_recorded_or_a_name_is_not_its_own() -> None:
    link: Any = SimpleNamespace(rival=lambda: "another service")
    alone: Any = SimpleNamespace(rival=lambda: "")
    broken: Any = SimpleNamespace(failed="the process that writes records has ended")
    well: Any = SimpleNamespace(failed=None)

    def warnings(recorder: Any, link: Any, off: str = "") -> tuple[str, ...]:
        publisher = StatePublisher(link=link, telemetry=link, dispatcher=link, rate_hz=100.0, off=off)
        return publisher.warnings(recorder)

    assert warnings(None, alone) == warnings(well, alone) == ()
    assert warnings(well, alone, off_sentence()) == (off_sentence(),)
    assert warnings(broken, link) == ("the record: the process that writes records has ended", "another service")
