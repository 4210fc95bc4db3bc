"""The two ends on which QTM's packets arrive: the SDK's TCP protocol, guarded, and our own datagram endpoint."""

import asyncio
import logging
import struct
from collections.abc import Callable
from typing import Any

from qtm_rt.packet import QRTEvent, QRTPacket
from qtm_rt.protocol import QRTCommandException, QTMProtocol
from qtm_rt.receiver import Receiver

from companion.adapters.qualisys.packets import DATA, HEADER, MalformedError, check_packet, split_packets
from companion.adapters.qualisys.source import QualisysSource
from companion.adapters.system.keepalive import keep_alive

LOG = logging.getLogger(__name__)

_ENDINGS = (QRTEvent.EventConnectionClosed, QRTEvent.EventCaptureStopped, QRTEvent.EventQTMShuttingDown)


class Link(QTMProtocol):  # type: ignore[misc]  # the SDK has no types
    """The SDK's protocol, fed with whole, checked packets only, and honest about its end.

    `on_failure` is told, as the end of a sentence that starts with 'QTM at ...', why nothing comes any more.
    """

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        super().__init__(loop=loop, on_event=self._on_qtm_event)
        self.failure: str | None = None
        self.on_failure: Callable[[str], None] = LOG.debug
        self.on_broken: Callable[[MalformedError], None] | None = None
        """Called with an unreadable packet, which is dropped; None: such a packet ends the connection."""
        self.on_settings_changed: Callable[[], None] = lambda: None
        self.closed = loop.create_future()
        self._unparsed = bytearray()
        self._settings: asyncio.Future[bytes] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Have the kernel notice a far side that has lost its power."""
        super().connection_made(transport)
        keep_alive(transport)

    async def settings(self, of: str) -> bytes:
        """Ask for a part of QTM's settings, XML; not more than once at a time, also while frames stream.

        Raises QRTCommandException when QTM refuses, ConnectionError when the connection ends before it answers. Not
        the SDK's `get_parameters`: that takes a frame for the answer, and cannot be asked while UDP frames stream.
        """
        answer: asyncio.Future[bytes] = self.loop.create_future()
        self._settings = answer
        self.send_command(f"getparameters {of}", callback=False)
        try:
            return await answer
        finally:
            self._settings = None

    def _on_xml(self, response: bytes) -> None:
        if self._settings is not None and not self._settings.done():
            self._settings.set_result(response)

    def _on_error(self, response: bytes) -> None:
        if self._settings is not None and not self._settings.done():
            self._settings.set_exception(QRTCommandException(response))
        else:
            super()._on_error(response)

    def data_received(self, data: bytes) -> None:
        """Pass whole packets on to the SDK; bytes that tell no longer where the next one begins end the connection."""
        self._unparsed += data
        try:
            packets = split_packets(self._unparsed)
        except MalformedError as error:
            self._break_off(error)
            return
        for packet in packets:
            if self.failure is None:
                self._take(packet)

    def _take(self, packet: bytes) -> None:
        try:
            check_packet(packet)
            super().data_received(packet)
        except (ValueError, struct.error) as error:
            self._receiver = Receiver(self._handlers)  # the old one would read the broken packet again before the next
            if self.on_broken is None:
                self._break_off(error)
            else:
                self.on_broken(MalformedError(str(error)))

    def connection_lost(self, exc: Exception | None) -> None:
        """Fail the questions that are still open: the SDK would leave them waiting."""
        super().connection_lost(exc)
        self._end("closed the connection" + (f" ({exc})" if exc else ""))
        for question in (*self.request_queue, *((self._settings,) if self._settings is not None else ())):
            if not question.done():
                question.set_exception(ConnectionError(self.failure))
        if not self.closed.done():
            self.closed.set_result(None)

    async def close(self) -> None:
        """Stop the stream and close; cut off when QTM does not take the last bytes."""
        if self.transport is None:
            return
        transport = self.transport
        self.send_command("streamframes stop", callback=False)
        transport.close()
        await asyncio.wait([self.closed], timeout=0.2)
        if not self.closed.done():
            transport.abort()
            await self.closed

    def end(self, reason: str) -> None:
        """Give the connection up, for this reason."""
        self._end(reason)
        if self.transport is not None:
            self.transport.abort()

    def _break_off(self, what: Exception) -> None:
        self.end(f"sent {what}: is it really QTM's little-endian port?")

    def _end(self, reason: str) -> None:
        if self.failure is None:
            self.failure = reason
            self.on_failure(reason)

    def _on_qtm_event(self, event: QRTEvent) -> None:
        level = logging.WARNING if event in _ENDINGS else logging.INFO
        LOG.log(level, "QTM says: %s", event.name.removeprefix("Event"))
        if event is QRTEvent.EventCameraSettingsChanged:
            self.on_settings_changed()


class Datagrams(asyncio.DatagramProtocol):
    """Frames that come by UDP, from QTM's address only; what is no frame is counted and dropped."""

    def __init__(self, source: QualisysSource, host: str) -> None:
        self._source = source
        self._host = host

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        """Parse one datagram: a packet with its header, as on TCP."""
        if addr[0] != self._host:
            if len(data) >= HEADER.size and HEADER.unpack_from(data) == (len(data), DATA):
                self._source.on_stray(str(addr[0]))
            return
        try:
            if len(data) < HEADER.size:
                raise MalformedError(f"{len(data)} bytes")
            check_packet(data)
            if HEADER.unpack_from(data)[1] == DATA:
                self._source.on_packet(QRTPacket(data[HEADER.size :]))
        except (ValueError, struct.error) as error:
            self._source.on_malformed(MalformedError(str(error)))
