"""One connection to a broker: aiomqtt's client, made to end at once and leave nothing behind.

As they are, aiomqtt and paho keep socket, reader and task of an attempt that failed or was cancelled, and may watch a
socket that is closed, or for ever one that has nothing to write; a packet that makes paho raise is handed to it again
and again without pause; and a packet may say that it has 256 MB, or have more properties than paho can read in time.
"""

import asyncio
import logging
import socket
import ssl
from collections.abc import Awaitable, Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import Self, TypeVar

import aiomqtt
import paho.mqtt.client as paho
from aiomqtt.exceptions import MqttConnectError
from aiomqtt.types import PahoSocket
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from companion.adapters.mqtt.packets import with_few_properties

_T = TypeVar("_T")
V5, V311 = aiomqtt.ProtocolVersion.V5, aiomqtt.ProtocolVersion.V311

ANSWER_S = 1.0
"""Whatever the broker does not answer within this, it does not answer."""
MAX_PACKET_BYTES = 64_000
"""To read more in one go would hold up the flight loop; a command has less."""
_MAX_OTHER_BYTES = 1024
"""Largest packet other than a message."""
KEEPALIVE_S = 5
"""After one and a half of these the broker gives us up and says so to everyone (the last will)."""

_QUIET = logging.getLogger("companion.adapters.mqtt.wire")
_QUIET.setLevel(logging.CRITICAL)
"""The libraries log every bad packet, which would fill a disk; what ends a connection is told once, in link.py."""


class UnansweredError(aiomqtt.MqttError):
    """CONNECT was not answered: some brokers mean that they know no MQTT 5 (amqtt 0.12)."""


@dataclass(frozen=True, kw_only=True)
class Endpoint:
    """Address, identity and TLS context of a broker connection."""

    host: str
    port: int
    identifier: str
    user: str | None
    password: str | None
    tls: ssl.SSLContext | None
    will: aiomqtt.Will | None


class Connection(aiomqtt.Client):
    """A context manager for one use: MqttError, OSError or ValueError when the broker cannot be had."""

    def __init__(self, endpoint: Endpoint, version: aiomqtt.ProtocolVersion, waiting: int) -> None:
        """`waiting`: messages that may wait to be read; what is more is lost."""
        self.version = version
        self.objection = ""
        """Reason why the broker accepted a message without delivering it, reported by MQTT 5."""
        bounds = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        bounds.MaximumPacketSize = MAX_PACKET_BYTES
        super().__init__(
            endpoint.host,
            endpoint.port,
            identifier=endpoint.identifier,
            username=endpoint.user,
            password=endpoint.password,
            tls_context=endpoint.tls,
            protocol=version,
            clean_session=None if version is V5 else True,
            properties=bounds if version is V5 else None,
            will=endpoint.will,
            timeout=ANSWER_S,
            keepalive=KEEPALIVE_S,
            max_queued_incoming_messages=waiting,
            logger=_QUIET,
        )
        self._client.connect_timeout = ANSWER_S
        self._host, self._tls = endpoint.host, endpoint.tls
        self._client._ssl_wrap_socket = self._encrypted  # type: ignore[method-assign, assignment]
        self._receive = self._client._sock_recv
        self._client._sock_recv = self._receive_bounded  # type: ignore[method-assign, assignment]
        self._publish = self._client._handle_publish
        if version is V5:
            self._client._handle_publish = self._publish_bounded  # type: ignore[method-assign]

    async def __aenter__(self) -> Self:
        """Connect. Whatever goes wrong, cancellation too, the socket is closed again."""
        try:
            await _to_its_end(self._loop.run_in_executor(None, self._client_connect))
            wire = self._client.socket()
            if isinstance(wire, socket.socket):
                wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            await self._acknowledged()
        except BaseException:
            await self._drop()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the socket without a farewell, so that the broker publishes the last will, however we end."""
        await self._drop()

    async def listen_to(self, topic: str) -> None:
        """Subscribe at QoS 1, and not to what the broker has kept; MqttError when it does not let us."""
        kept = SubscribeOptions(qos=1, retainAsPublished=True, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND)
        granted = await (self.subscribe(topic, options=kept) if self.version is V5 else self.subscribe(topic, qos=1))
        self.require_granted(granted, topic)

    @staticmethod
    def require_granted(codes: Iterable[int | ReasonCode], topic: str) -> None:
        """Raise MqttError when the broker has refused a subscription."""
        if any((code if isinstance(code, int) else code.value) >= 0x80 for code in codes):
            raise aiomqtt.MqttError(f"refuses the subscription to {topic}")

    def check(self) -> None:
        """Raise MqttError when the broker sends unsubscribed messages at QoS 2, which paho stores without limit."""
        if self._client._in_messages:
            raise aiomqtt.MqttError("a message at QoS 2, which was not asked for")

    async def _acknowledged(self) -> None:
        ends = (self._connected, self._disconnected)
        await asyncio.wait(ends, timeout=ANSWER_S, return_when=asyncio.FIRST_COMPLETED)
        if self._disconnected.done():
            raise UnansweredError("closed the connection instead of an answer") from self._disconnected.exception()
        if not self._connected.done():
            raise UnansweredError("no answer to CONNECT")
        self._connected.result()

    async def _wait_for(self, fut: Awaitable[_T], timeout: float | None) -> _T:  # noqa: ASYNC109 - aiomqtt's
        """Wait as aiomqtt does, and end when cancelled: wait_for loses a cancellation if the answer arrives then."""
        try:
            async with asyncio.timeout(self.timeout if timeout is None else timeout):
                return await fut
        except TimeoutError:
            raise aiomqtt.MqttError("no answer") from None

    def _on_disconnect(
        self,
        client: paho.Client,
        userdata: object,
        flags: paho.DisconnectFlags,
        reason_code: ReasonCode,
        properties: Properties | None = None,
    ) -> None:
        """Handle a disconnect as aiomqtt does, and also before CONNACK, for which it would wait until the timeout."""
        if not self._connected.done() and not self._disconnected.done():
            self._disconnected.set_result(None)
        super()._on_disconnect(client, userdata, flags, reason_code, properties)

    def _on_publish(
        self, client: paho.Client, userdata: object, mid: int, reason_code: ReasonCode, properties: Properties
    ) -> None:
        if reason_code.is_failure:
            self.objection = str(reason_code)
        super()._on_publish(client, userdata, mid, reason_code, properties)

    def _on_socket_register_write(
        self,
        client: paho.Client,
        userdata: object,  # noqa: ARG002
        sock: PahoSocket,
    ) -> None:
        """Register the socket for writing in the next loop iteration, unless it is closed or has nothing to write.

        Its file descriptor would be invalid or reused, and a writer registered too late would never be removed.
        """

        def write() -> None:
            try:
                client.loop_write()
            except Exception as error:  # a broken pipe, as a rule
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        def register() -> None:
            if sock.fileno() >= 0 and client.want_write():
                self._loop.add_writer(sock.fileno(), write)

        self._loop.call_soon_threadsafe(register)

    async def _drop(self) -> None:
        self._client._sock_close()
        for end in (self._connected, self._disconnected):
            if end.done() and not end.cancelled():
                end.exception()  # retrieved, or asyncio logs that it never was
        if self._misc_task is not None:
            self._misc_task.cancel()
            await asyncio.wait([self._misc_task])

    def _encrypted(self, plain: socket.socket) -> ssl.SSLSocket:
        """Wrap the socket with TLS as paho does, and close it when the handshake fails."""
        assert self._tls is not None
        wire = self._tls.wrap_socket(plain, server_hostname=self._host, do_handshake_on_connect=False)
        try:
            wire.settimeout(ANSWER_S)
            wire.do_handshake()
        except BaseException:
            wire.close()
            raise
        return wire

    def _receive_bounded(self, size: int) -> bytes:
        """Read up to `size` bytes, those missing of the current packet; ConnectionError when that is too large."""
        message = self._client._in_packet["command"] & 0xF0 == paho.PUBLISH
        if size > (MAX_PACKET_BYTES if message else _MAX_OTHER_BYTES):
            raise ConnectionError(f"a packet of {size} bytes")
        return self._receive(size)

    def _publish_bounded(self) -> MQTTErrorCode:
        packet = self._client._in_packet
        packet["packet"] = bytearray(with_few_properties(bytes(packet["packet"]), (packet["command"] & 0x06) >> 1))
        return self._publish()


def knows_no_mqtt5(error: BaseException) -> bool:
    """Return True when the broker rejects the connection because it does not support MQTT 5."""
    if not isinstance(error, MqttConnectError):
        return False
    return isinstance(error.rc, ReasonCode) and error.rc.getName() == "Unsupported protocol version"


async def _to_its_end(work: "asyncio.Future[None]") -> None:
    """Wait for a thread, also when cancelled: it opens a socket that must be closed. It takes ANSWER_S at most,
    apart from the name service.
    """
    try:
        await asyncio.shield(work)
    except asyncio.CancelledError:
        await asyncio.wait([work])
        if not work.cancelled():
            work.exception()  # nobody else asks for it, which asyncio would log
        raise
