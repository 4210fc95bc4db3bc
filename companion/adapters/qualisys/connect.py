"""Connection to QTM: a running stream from an address, and a new one whenever it is lost."""

import asyncio
import logging
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager

from qtm_rt.protocol import QRTCommandException

from companion.adapters.qualisys.handshake import UnreachableError, agree_on_version, ask_bodies, connect, text, where
from companion.adapters.qualisys.link import Datagrams, Link
from companion.adapters.qualisys.source import QualisysSource
from companion.adapters.qualisys.stream_watch import end_when_silent, keep_bodies_current
from companion.adapters.system.background import background
from companion.config.mocap_config import MocapConfig
from companion.core.interfaces import Clock, MocapError

LOG = logging.getLogger(__name__)

_AGAIN_S = 0.1
"""Between two attempts to find QTM again: the first one is in time for a flight to outlive a broken connection."""


@asynccontextmanager
async def open_qualisys(config: MocapConfig, clock: Clock, others: Sequence[str] = ()) -> AsyncIterator[QualisysSource]:
    """Connect, find the body, start the stream, wait for its first frame; on leaving, stop and close.

    `others` are the bodies of the other vehicles, which may be missing.

    Raises MocapError when any of that fails. Later nothing is raised: an unreadable packet is dropped, and a lost
    connection shows as silence, which the reader of frames judges, while the source reconnects in the background.
    """
    source = QualisysSource(config.body, where(config), clock, others)
    async with AsyncExitStack() as connection:
        link = await connection.enter_async_context(_streaming(config, source, source.fail))
        if source.trouble:
            raise MocapError(source.why_silent())
        if not await source.wait_unseen(config.first_frame_timeout_s):
            raise MocapError(_no_frames(config, source))
        link.on_failure, link.on_broken = LOG.debug, source.on_malformed
        try:
            async with background(_keep_streaming(config, source, link, connection), "companion.qualisys"):
                yield source
        finally:
            source.fail("is not listened to any more")


@asynccontextmanager
async def _streaming(
    config: MocapConfig, source: QualisysSource, on_failure: Callable[[str], None]
) -> AsyncIterator[Link]:
    """Open a connection and request frames; `on_failure` gets the reason when it ends."""
    link = await connect(config)
    datagrams: asyncio.DatagramTransport | None = None
    try:
        await agree_on_version(link, config)
        source.doubt_bodies()
        source.take_bodies(await ask_bodies(link, config))
        link.on_failure, link.on_settings_changed = on_failure, source.doubt_bodies
        if config.transport == "udp":
            datagrams = await _open_datagrams(link, source, config)
        _start_stream(link, source, datagrams)
        reading = keep_bodies_current(link, source, config.connect_timeout_s)
        async with background(reading, "companion.qualisys.bodies"):
            yield link
    finally:
        if datagrams is not None:
            datagrams.close()
        await link.close()


async def _keep_streaming(config: MocapConfig, source: QualisysSource, link: Link, connection: AsyncExitStack) -> None:
    """Reconnect whenever the link is lost and replace it in `connection`; until cancelled."""
    while True:
        await end_when_silent(link, source)
        await asyncio.wait([link.closed])
        if source.on_frame is None:  # a frame had come: the loss is news
            LOG.error("no frames until QTM is back: QTM at %s %s", where(config), link.failure)
        source.on_frame = lambda: LOG.warning("QTM at %s is back", where(config))
        link = await _found_again(config, source, connection)
        link.on_broken = source.on_malformed


async def _found_again(config: MocapConfig, source: QualisysSource, connection: AsyncExitStack) -> Link:
    """Retry until there is a stream; log each objection of a QTM that answers once."""
    last_error = ""
    while True:
        await connection.aclose()
        await asyncio.sleep(_AGAIN_S)
        try:
            return await connection.enter_async_context(_streaming(config, source, LOG.debug))
        except UnreachableError as error:
            LOG.debug("%s", error)
        except MocapError as error:
            LOG.log(logging.DEBUG if str(error) == last_error else logging.WARNING, "%s", error)
            last_error = str(error)


async def _open_datagrams(link: Link, source: QualisysSource, config: MocapConfig) -> asyncio.DatagramTransport:
    if link.transport is None:
        raise MocapError(f"QTM at {where(config)} closed the connection")
    here, there = link.transport.get_extra_info("sockname")[0], link.transport.get_extra_info("peername")[0]
    receiver = _bound_socket(here, config.udp_port)
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: Datagrams(source, there), sock=receiver)
    return transport


def _bound_socket(host: str, port: int) -> socket.socket:
    """Return a UDP socket bound here, not by the event loop: uvloop leaks one whose port is taken."""
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
            link.end(f"refuses to stream ({text(error)})")

    try:
        link.send_command(f"streamframes allframes{udp} 6dres").add_done_callback(on_answer)
    except QRTCommandException:
        link.end("closed the connection")


def _no_frames(config: MocapConfig, source: QualisysSource) -> str:
    if source.trouble:
        return source.why_silent()
    if source.stray:
        return (
            f"frames come from {source.stray}, not from mocap.host {config.host}: give mocap.host the address that QTM "
            'sends from, or mocap.transport = "tcp"'
        )
    hint = ", and let UDP through the firewall" if config.transport == "udp" else ""
    return (
        f"QTM at {where(config)} is connected but sends no frames: "
        f"start the capture (Capture > New, real-time on){hint}"
    )
