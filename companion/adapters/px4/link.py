"""The connection to PX4: opened, the right autopilot found on it, and closed without leaving anything to call back."""

import asyncio
import contextlib
import ctypes
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from typing import Any

from mavsdk.autopilot import Autopilot
from mavsdk.cmavsdk_loader import _cmavsdk_lib
from mavsdk.component_type import ComponentType
from mavsdk.connection_result import ConnectionResult
from mavsdk.logging import LogCallback
from mavsdk.mavsdk import Configuration, Mavsdk

from companion.adapters.px4.autopilot import Px4
from companion.adapters.px4.sender_lock import SenderLock
from companion.adapters.system.background import background
from companion.adapters.system.log_lines import LineLimit, printable
from companion.config.px4_config import Px4Config
from companion.core.interfaces import AutopilotError, Clock

_LOOK_S, _LOOK_AGAIN_S = 0.02, 0.2
_ADVICE = {
    ConnectionResult.BIND_ERROR: "is another program using that port?",
    ConnectionResult.CONNECTION_URL_INVALID: (
        "not a MAVSDK URL such as udpin://127.0.0.1:14540 or serial:///dev/ttyUSB0:921600"
    ),
}
_ADVICE_ELSE = "is the device there, and may we use it?"
_NAMES = {
    Autopilot.PX4: "PX4",
    Autopilot.ARDUPILOT: "ArduPilot",
    Autopilot.GENERIC: "a generic autopilot",
    Autopilot.UNKNOWN: "unknown",
}


LOG = logging.getLogger("companion.adapters.px4.mavsdk")

_LEVELS = {0: logging.DEBUG, 1: logging.DEBUG, 2: logging.INFO, 3: logging.INFO}
"""One step quieter than MAVSDK thinks: what matters to the operator comes as an exception."""
_OURS = "Received ack for not-existing command"
"""Logged for every command that we send without MAVSDK."""


_LIMIT = LineLimit()


def _take(level: int, message: bytes | None, _file: bytes | None, _line: int, _data: Any) -> bool:
    """Log one message; True: MAVSDK need not print it. Its own Python wrapper fails on bytes that are no UTF-8."""
    with contextlib.suppress(Exception):  # without memory nothing can be said, and MAVSDK must not begin to print
        text = printable((message or b"").decode("utf-8", "replace"))
        if not text.startswith(_OURS):
            _LIMIT.log(lambda more: LOG.log(_LEVELS.get(level, logging.INFO), "%s%s", text, more))
    return True


_CALLBACK = LogCallback(_take)
"""Kept for as long as the process lives: MAVSDK's threads may say something at any time."""


def take_native_log() -> None:
    """Have MAVSDK's messages logged from now on instead of printed to standard output."""
    _cmavsdk_lib.mavsdk_log_subscribe(_CALLBACK, ctypes.c_void_p(None))


@asynccontextmanager
async def open_px4(config: Px4Config, clock: Clock) -> AsyncIterator[Px4]:
    """Connect and yield the autopilot; AutopilotError for a port in use, for silence, and for one that is not PX4."""
    take_native_log()
    # As a ground station: PX4 sends its STATUSTEXTs (why it will not arm) only to links where one is heard.
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    mavsdk = Mavsdk(configuration)
    try:
        result = mavsdk.add_any_connection(config.url)
        if result != ConnectionResult.SUCCESS:
            raise AutopilotError(f"cannot open {config.url}: {_ADVICE.get(result, _ADVICE_ELSE)}")
        with closing(SenderLock(config, clock)) as sender_lock:
            system = await _autopilot(mavsdk, sender_lock, config, clock)
            px4 = Px4(system, config, clock, (configuration.system_id, configuration.component_id))
            async with background(_watch_other_autopilots(mavsdk, sender_lock, px4), "companion.px4.look"):
                try:
                    await px4.ask_for_messages()
                    px4.warnings += (sender_lock.warning,) if sender_lock.warning else ()
                    yield px4
                finally:
                    await px4.close()
    finally:
        _destroy(mavsdk, configuration)


async def _autopilot(mavsdk: Mavsdk, sender_lock: SenderLock, config: Px4Config, clock: Clock) -> Any:
    """Return the system that is flown: the configured one, or the first autopilot heard."""
    end_s = clock.now_s() + config.connect_timeout_s
    while True:
        sender_lock.look()
        systems = _autopilots(mavsdk)
        for system in systems:
            if config.system_id in {None, system.get_system_id()}:
                _require_px4(system, config)
                return system
        if clock.now_s() > end_s:
            heard = {system.get_system_id() for system in systems} | set(sender_lock.other_autopilots())
            raise AutopilotError(_not_heard(config, sorted(heard)))
        await asyncio.sleep(_LOOK_S)


async def _watch_other_autopilots(mavsdk: Mavsdk, sender_lock: SenderLock, px4: Px4) -> None:
    """List the other autopilots, those behind the accepted sender (a router) and those that send to the port."""
    while True:
        sender_lock.heard_s = px4.status().heard_s
        sender_lock.look()
        behind = [system for system in _autopilots(mavsdk) if system.get_system_id() != px4.status().system_id]
        px4.other_autopilots = (
            *(f"system {one.get_system_id()} ({_NAMES.get(one.autopilot_type(), 'unknown')})" for one in behind),
            *(words for found in sender_lock.other_autopilots().values() for words in found),
        )
        await asyncio.sleep(_LOOK_AGAIN_S)


def _autopilots(mavsdk: Mavsdk) -> list[Any]:
    return [system for system in mavsdk.get_systems() if system.is_connected() and system.has_autopilot()]


def _require_px4(system: Any, config: Px4Config) -> None:
    kind = system.autopilot_type()
    if kind is not Autopilot.PX4:
        raise AutopilotError(
            f"the autopilot on {config.url} (system {system.get_system_id()}) is not PX4 but "
            f"{_NAMES.get(kind, 'of a kind that MAVSDK does not know')}: this service flies PX4 alone"
        )


def _not_heard(config: Px4Config, others: list[int]) -> str:
    if not others:
        return (
            f"no autopilot heard on {config.url} within {config.connect_timeout_s:g} s: is PX4 (or the mock) "
            "running and sending MAVLink to this address?"
        )
    heard = ", ".join(map(str, others))
    return (
        f"px4.system_id = {config.system_id} was not heard on {config.url} within {config.connect_timeout_s:g} s, only "
        f"system {heard}: set px4.system_id to the vehicle's MAV_SYS_ID"
    )


def _destroy(mavsdk: Mavsdk, configuration: Configuration) -> None:
    """Close the connection; the callbacks live until MAVSDK's threads have ended, which may hold some in a queue."""
    systems = list(mavsdk._children)
    plugins = [plugin for system in systems for plugin in system._plugins]
    kept = [list(owner._subscriptions.values()) for owner in (mavsdk, *systems, *plugins)]
    mavsdk.destroy()
    configuration.destroy()
    del kept
