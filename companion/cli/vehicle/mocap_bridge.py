"""`companion mocap-bridge`: forward QTM's frames to the broker, on the room's workstation."""

import asyncio
import logging
import math
import shutil
import signal
import sys
from collections.abc import Callable
from typing import Annotated

import typer
import uvloop

from companion.adapters.system.background import first_of
from companion.adapters.system.clock import MonotonicClock
from companion.adapters.system.systemd import logging_to
from companion.cli.options import VehicleConfigFile, vehicle_settings
from companion.config.locations import vehicle_config_path
from companion.core.interfaces import ConfigError
from companion.service.mocap_bridge import Bridge, Glance

LOG = logging.getLogger("companion.mocap_bridge")
_SHOWN_S = 1.0
_LOGGED = 60
"""Seconds between lines without news in a log."""
_OLD_S = 1.0
_CLEAR = "\r\x1b[K"


def mocap_bridge(
    config: VehicleConfigFile = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log all messages.")] = False,
) -> None:
    """Forward motion capture: read QTM and send every frame to the broker at once, until Ctrl-C.

    For the room's workstation, when the vehicle takes its frames over MQTT (mocap.source = mqtt). Waits for QTM and
    the broker. Exit codes: 0 after Ctrl-C or SIGTERM, 2 for a configuration that cannot be used, or when another
    bridge forwards this vehicle.
    """
    settings = vehicle_settings(config, logs=True)
    if settings.mocap.source != "mqtt":
        raise ConfigError(
            f"{config or vehicle_config_path()}: "
            'mocap.source = "qualisys": the service with this configuration listens to QTM and to no bridge; give '
            'source = "mqtt" in [mocap], here and there'
        )
    bridge = Bridge(settings.mocap, settings.mocap_broker(), MonotonicClock())
    with logging_to(sys.stderr, logging.DEBUG if verbose else logging.INFO):
        LOG.info("configuration %s", config or vehicle_config_path())
        uvloop.run(_until_stopped(bridge))


async def _until_stopped(bridge: Bridge) -> None:
    stopped = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    try:
        await first_of(bridge.run(), _show(bridge, _write), stopped.wait())
    finally:
        if sys.stdout.isatty():
            typer.echo()


async def _show(bridge: Bridge, write: Callable[[str, str], None]) -> None:
    """Write the bridge's state once a second."""
    loop, before, before_s = asyncio.get_running_loop(), bridge.glance(), asyncio.get_running_loop().time()
    while True:
        await asyncio.sleep(_SHOWN_S)
        now, now_s = bridge.glance(), loop.time()
        write(line_of(now, (now.sent - before.sent) / (now_s - before_s)), now.trouble)
        before, before_s = now, now_s


def line_of(now: Glance, rate_hz: float) -> str:
    """Return the bridge's state as one line, the reason early as terminals cut the end; `rate_hz` of sent frames."""
    if math.isinf(now.age_s):
        age = "none yet"
    else:
        age = f"newest {1e3 * now.age_s:.0f} ms old" if now.age_s < _OLD_S else f"newest {now.age_s:.0f} s old"
    body = "" if now.tracked or math.isinf(now.age_s) else ", body not tracked"
    trouble = f": {now.trouble}" if now.trouble else ""
    dropped = f"dropped {now.dropped} from QTM, {now.passed_over} for the broker"
    return f"{rate_hz:5.1f} frames/s, {age}{body}{trouble}; {dropped}"


class _Writer:
    """Writer of one changing line on a terminal, else of a line for news and one a minute."""

    def __init__(self) -> None:
        self._trouble: str | None = None
        self._since = 0

    def __call__(self, line: str, trouble: str) -> None:
        if sys.stdout.isatty():
            sys.stdout.write(_CLEAR + line[: shutil.get_terminal_size().columns - 1])
            sys.stdout.flush()
            return
        self._since += 1
        if trouble != self._trouble or self._since >= _LOGGED:
            self._trouble, self._since = trouble, 0
            typer.echo(line)


_write = _Writer()
