"""Keeps the embedded broker's process: starts it, and starts it again when it ends or hangs.

Not on the control loop's interpreter: amqtt takes milliseconds for a packet. It speaks MQTT 3.1.1.
"""

import asyncio
import logging
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from companion.adapters.system import child_process
from companion.adapters.system.background import background
from companion.config.operator_config import OperatorConfig
from companion.core.interfaces import ConfigError

LOG = logging.getLogger(__name__)

_START_S = 20.0
_AGAIN_S, _LONGEST_S = 1.0, 10.0
"""Pause before it is begun again, and at most, when it does not begin."""
_STOP_S = 3.0
READY = b"ready\n"
ALIVE, ALIVE_EVERY_S = b".", 0.5
"""Sign of life on the standard output of the process, and its period."""
_HUNG_S = 5.0
"""A process without output for this time is killed."""


@asynccontextmanager
async def open_broker(config: OperatorConfig) -> AsyncIterator[None]:
    """Begin it, and begin it again when it dies, until the end; ConfigError when its port is another's."""
    _require_free(config)
    process = await _begin(config)
    async with background(_keep(config, process), "companion.broker"):
        yield


def _require_free(config: OperatorConfig) -> None:
    with socket.socket() as free:
        free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            free.bind((config.host, config.port))
        except OSError as error:
            raise ConfigError(
                f"operator.port = {config.port}: no broker can begin on it ({error.strerror}): is there one already? "
                "Give [operator] with embedded = false to use that one, or another port"
            ) from error


async def _begin(config: OperatorConfig) -> asyncio.subprocess.Process:
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "companion.adapters.broker",
        config.host,
        str(config.port),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdout is not None
    try:
        async with asyncio.timeout(_START_S):
            line = await process.stdout.readline()
    except BaseException as error:
        await child_process.end(process, _STOP_S)
        if isinstance(error, TimeoutError):
            raise ConfigError(f"the embedded broker was not ready within {_START_S:g} s") from error
        raise
    if line != READY:
        await child_process.end(process, _STOP_S)
        why = line.decode(errors="replace").strip() or "it ended without a word: is amqtt installed?"
        raise ConfigError(f"the embedded broker on port {config.port} does not begin: {why}")
    return process


async def _keep(config: OperatorConfig, process: asyncio.subprocess.Process) -> None:
    try:
        while True:
            why = await _end_of(process)
            LOG.error("the embedded broker %s and is started again", why)
            process = await _begin_again(config)
            LOG.info("the embedded broker is there again")
    finally:
        await child_process.end(process, _STOP_S)


async def _end_of(process: asyncio.subprocess.Process) -> str:
    """Wait until it has ended, or says no more that it lives; kill it then. Return which."""
    assert process.stdout is not None
    try:
        while True:
            async with asyncio.timeout(_HUNG_S):
                if not await process.stdout.read(1024):
                    break
    except TimeoutError:
        process.kill()
        await process.wait()
        return f"has said nothing for {_HUNG_S:g} s"
    await child_process.end(process, _STOP_S)
    return f"has ended ({process.returncode})"


async def _begin_again(config: OperatorConfig) -> asyncio.subprocess.Process:
    pause_s, last_error = _AGAIN_S, ""
    while True:
        await asyncio.sleep(pause_s)
        pause_s = min(2.0 * pause_s, _LONGEST_S)
        try:
            return await _begin(config)
        except (ConfigError, OSError) as error:
            if str(error) != last_error:
                last_error = str(error)
                LOG.error("%s", last_error)  # noqa: TRY400 - the sentence is for the operator
