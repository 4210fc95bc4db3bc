"""From an address to a running stream, with a sentence for everything that can be wrong on the way."""

import asyncio
import logging
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager

from qtm_rt.protocol import QRTCommandException

from companion.adapters.qualisys.link import Datagrams, Link
from companion.adapters.qualisys.packets import MalformedError, body_names
from companion.adapters.qualisys.source import QualisysSource
from companion.config_mocap import MocapConfig
from companion.ports import Clock, MocapError

LOG = logging.getLogger(__name__)

PROTOCOL_VERSION = "1.25"
_AGAIN_S = 0.1
"""Between two attempts to find QTM again: the first one is in time for a flight to outlive a broken connection."""


@asynccontextmanager
async def open_qualisys(config: MocapConfig, clock: Clock) -> AsyncIterator[QualisysSource]:
    """Connect, find the body, start the stream, wait for its first frame; on leaving, stop and close.

    Raises MocapError when any of that fails. Later nothing does: a packet that nobody can read is dropped, and a lost
    connection is silence, for whoever waits for frames to judge, while QTM is looked for again in the background.
    """
    source = QualisysSource(0, _where(config), clock)
    async with AsyncExitStack() as connection:
        link = await connection.enter_async_context(_streaming(config, source, source.fail))
        if not await source.wait_unseen(config.first_frame_timeout_s):
            raise MocapError(_no_frames(config))
        link.on_failure, link.on_broken = LOG.debug, source.on_malformed
        keeping = asyncio.create_task(_keep_streaming(config, source, link, connection), name="companion.qualisys")
        try:
            yield source
        finally:
            keeping.cancel()
            await asyncio.gather(keeping, return_exceptions=True)
            source.fail("is not listened to any more")


@asynccontextmanager
async def _streaming(
    config: MocapConfig, source: QualisysSource, on_failure: Callable[[str], None]
) -> AsyncIterator[Link]:
    """A connection on which frames have been asked for; `on_failure` is told what ends it."""
    link = await _connect(config)
    datagrams: asyncio.DatagramTransport | None = None
    try:
        source.index = await _body_index(link, config)
        link.on_failure = on_failure
        if config.transport == "udp":
            datagrams = await _open_datagrams(link, source, config)
        _start_stream(link, source, datagrams)
        yield link
    finally:
        if datagrams is not None:
            datagrams.close()
        await link.close()


async def _keep_streaming(config: MocapConfig, source: QualisysSource, link: Link, connection: AsyncExitStack) -> None:
    """Whenever the link is lost, have another one in its place in `connection`; until cancelled."""
    while True:
        await asyncio.wait([link.closed])
        LOG.error("no frames until QTM is back: QTM at %s %s", _where(config), link.failure)
        link = await _found_again(config, source, connection)
        link.on_broken = source.on_malformed
        LOG.warning("QTM at %s is back", _where(config))


async def _found_again(config: MocapConfig, source: QualisysSource, connection: AsyncExitStack) -> Link:
    while True:
        await connection.aclose()
        await asyncio.sleep(_AGAIN_S)
        try:
            return await connection.enter_async_context(_streaming(config, source, LOG.debug))
        except MocapError as error:
            LOG.debug("%s", error)


async def _connect(config: MocapConfig) -> Link:
    """Open the TCP connection.

    The SDK's own `connect` returns None for every failure and never gives up on a silent server.
    """
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(config.connect_timeout_s):
            _, link = await loop.create_connection(Link, config.host, config.port)
    except TimeoutError as error:
        raise MocapError(
            f"QTM at {_where(config)} does not answer within {config.connect_timeout_s:g} s: "
            "check the address, the network and the firewall"
        ) from error
    except OSError as error:
        raise MocapError(
            f"no QTM at {_where(config)} ({error.strerror or error}): start QTM or correct mocap.host and mocap.port"
        ) from error
    return link


async def _body_index(link: Link, config: MocapConfig) -> int:
    """Agree on the version and look the body up; its place in the settings is its place in the data."""
    try:
        async with asyncio.timeout(config.connect_timeout_s):
            await link.set_version(PROTOCOL_VERSION)
            # not QRTConnection.get_parameters: its wait_for may swallow a cancellation (Python 3.11), and so Ctrl-C
            names = body_names(await link.send_command("getparameters 6d"))
    except TimeoutError as error:
        raise MocapError(
            f"QTM at {_where(config)} accepts connections but does not answer: is it QTM's little-endian port (22223)?"
        ) from error
    except ConnectionError as error:
        raise MocapError(f"QTM at {_where(config)} {error}") from error
    except QRTCommandException as error:
        if link.transport is None:
            raise MocapError(f"QTM at {_where(config)} {link.failure}") from error
        raise MocapError(
            f"QTM at {_where(config)} refuses protocol version {PROTOCOL_VERSION} or its settings ({_text(error)})"
        ) from error
    except MalformedError as error:
        raise MocapError(f"QTM at {_where(config)} sent {error}") from error
    if config.body in names:
        return names.index(config.body)
    if not names:
        raise MocapError(f"QTM at {_where(config)} has no rigid bodies: define '{config.body}' in its 6DOF settings")
    raise MocapError(f"QTM at {_where(config)} does not know the body '{config.body}'; it has: {', '.join(names)}")


async def _open_datagrams(link: Link, source: QualisysSource, config: MocapConfig) -> asyncio.DatagramTransport:
    """Listen for frames on the interface through which QTM was reached."""
    if link.transport is None:
        raise MocapError(f"QTM at {_where(config)} closed the connection")
    here, there = link.transport.get_extra_info("sockname")[0], link.transport.get_extra_info("peername")[0]
    receiver = _bound_socket(here, config.udp_port)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: Datagrams(source, there), sock=receiver)
    return transport


def _bound_socket(host: str, port: int) -> socket.socket:
    """A UDP socket, bound here and not by the event loop: uvloop leaks one whose port is taken."""
    receiver = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
    receiver.setblocking(False)
    try:
        receiver.bind((host, port))
    except OSError as error:
        receiver.close()
        raise MocapError(
            f"cannot receive frames on UDP {host}:{port} ({error.strerror or error}): choose another "
            "mocap.udp_port, or 0 for any"
        ) from error
    return receiver


def _start_stream(link: Link, source: QualisysSource, datagrams: asyncio.DatagramTransport | None) -> None:
    """Ask for every frame.

    Not with the SDK's `stream_frames`: that waits for a first frame on TCP, where none comes in UDP mode.
    """
    udp = f" udp:{datagrams.get_extra_info('sockname')[1]}" if datagrams is not None else ""
    link.set_on_packet(source.on_packet)

    def on_answer(answer: asyncio.Future[object]) -> None:
        error = None if answer.cancelled() else answer.exception()
        if isinstance(error, QRTCommandException):
            link.end(f"refuses to stream ({_text(error)})")

    try:
        link.send_command(f"streamframes allframes{udp} 6dres").add_done_callback(on_answer)
    except QRTCommandException:
        link.end("closed the connection")


def _no_frames(config: MocapConfig) -> str:
    hint = ", and let UDP through the firewall" if config.transport == "udp" else ""
    return (
        f"QTM at {_where(config)} is connected but sends no frames: "
        f"start the capture (Capture > New, real-time on){hint}"
    )


def _where(config: MocapConfig) -> str:
    return f"{config.host}:{config.port}"


def _text(error: BaseException) -> str:
    """The SDK puts QTM's answer, as bytes, into its exception."""
    value = getattr(error, "value", error)
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
