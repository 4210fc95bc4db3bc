"""Handshake with QTM: TCP connection, protocol version, list of rigid bodies."""

import asyncio
import logging

from qtm_rt.protocol import QRTCommandException

from companion.adapters.qualisys.bodies import RigidBody, rigid_bodies
from companion.adapters.qualisys.link import Link
from companion.adapters.qualisys.packets import MalformedError
from companion.config.mocap_config import MocapConfig
from companion.core.interfaces import MocapError

LOG = logging.getLogger(__name__)

NEWEST_MINOR, OLDEST_MINOR = 25, 18
"""RT protocol 1.25 (QTM of mid-2024) down to 1.18 (October 2018): the component 6dres is the same in all of them."""
_TELLS_ENABLED, _TELLS_RELATIVE = 24, 21
"""Versions from which on settings tell of a body whether it is enabled, and relative to another one."""


class UnreachableError(MocapError):
    """Error: nothing answers at QTM's address."""


def where(config: MocapConfig) -> str:
    """Return QTM's address as "host:port"."""
    return f"{config.host}:{config.port}"


async def connect(config: MocapConfig) -> Link:
    """Open the TCP connection; UnreachableError. The SDK's own returns None, and waits for ever."""
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(config.connect_timeout_s):
            _, link = await loop.create_connection(Link, config.host, config.port)
    except TimeoutError as error:
        raise UnreachableError(
            f"QTM at {where(config)} does not answer within {config.connect_timeout_s:g} s: "
            "check the address, the network and the firewall"
        ) from error
    except OSError as error:
        raise UnreachableError(
            f"no QTM at {where(config)} ({error.strerror or error}): start QTM or correct mocap.host and mocap.port"
        ) from error
    return link


async def agree_on_version(link: Link, config: MocapConfig) -> int:
    """Agree on the newest version of the RT protocol that QTM knows, 1.N, and return N; MocapError."""
    for minor in range(NEWEST_MINOR, OLDEST_MINOR - 1, -1):
        try:
            async with asyncio.timeout(config.connect_timeout_s):
                await link.set_version(f"1.{minor}")
        except QRTCommandException as error:
            if link.transport is None or "version" not in text(error).lower():
                raise _refusal(link, config, error) from error
        except (TimeoutError, ConnectionError) as error:
            raise _refusal(link, config, error) from error
        else:
            _tell_what_is_lost(minor, config)
            return minor
    raise MocapError(
        f"QTM at {where(config)} knows no version of the RT protocol from 1.{NEWEST_MINOR} down to 1.{OLDEST_MINOR}: "
        "is it a QTM from before October 2018, or port 22222, which has version 1.0 only (22223 is the one to use)?"
    )


async def ask_bodies(link: Link, config: MocapConfig) -> tuple[RigidBody, ...]:
    """Ask for QTM's rigid bodies, in the order of the frames; MocapError."""
    try:
        async with asyncio.timeout(config.connect_timeout_s):
            return rigid_bodies(await link.settings("6d"))
    except (TimeoutError, ConnectionError, QRTCommandException, MalformedError) as error:
        raise _refusal(link, config, error) from error


def text(error: BaseException) -> str:
    """Return QTM's answer, which the SDK puts into its exception as bytes."""
    value = getattr(error, "value", error)
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _refusal(link: Link, config: MocapConfig, error: Exception) -> MocapError:
    at = f"QTM at {where(config)}"
    if link.failure is not None:
        return MocapError(f"{at} {link.failure}")
    if isinstance(error, TimeoutError):
        return MocapError(
            f"{at} accepts connections but does not answer: is it QTM's little-endian port (22223 if its base port is "
            "22222)?"
        )
    if isinstance(error, MalformedError):
        return MocapError(f"{at} sent {error}")
    return MocapError(f"{at} refuses to talk ({text(error)})")


def _tell_what_is_lost(minor: int, config: MocapConfig) -> None:
    if minor >= _TELLS_ENABLED:
        return
    lost = "is disabled" if minor >= _TELLS_RELATIVE else "is disabled, or relative to another one"
    LOG.warning("QTM at %s speaks RT protocol 1.%d, which does not tell whether a body %s", where(config), minor, lost)
