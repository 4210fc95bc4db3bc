"""amqtt's broker without the defects that cost clients, commands and last wills (read in amqtt 0.12.1).

As it is, amqtt 0.12.1
- iterates over all subscriptions while it waits for a new client's acknowledgements: another client that comes or goes
  in between raises RuntimeError ("dictionary changed size during iteration"), and the new client is dropped;
- sends a new client the retained messages of topics that others have subscribed to;
- acknowledges what a client publishes and drops it when the client's message loop has failed or has just ended;
- reads MQTT 5's CONNECT as one of MQTT 3.1.1 and waits for bytes that never come, so that the client hangs;
- never gives up a silent client, so that its last will is not published, nor an older connection of the same client;
- may clear away a session that its client has just taken up again;
- waits for ever for the end of a client that has gone before amqtt began to wait for it.
"""

import asyncio
import contextlib
from collections import UserDict
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

from amqtt.adapters import StreamReaderAdapter, StreamWriterAdapter  # type: ignore[import-untyped]
from amqtt.broker import Broker  # type: ignore[import-untyped]

_CONNECT_S = 5.0
"""A connection without a complete CONNECT within this is closed."""
_MAX_CONNECT_BYTES = 64_000
_CLOSE_S = 1.0
"""For the last bytes to leave; then the connection is cut."""
_GRACE_S = 2
"""Added to every client's keep-alive; MQTT asks for half of it."""
_CONNECT = 0x10
_LEVEL_311, _LEVEL_5 = 4, 5
_BAD_VERSION_5 = b"\x20\x03\x00\x84\x00"
"""CONNACK of MQTT 5: unsupported protocol version (MQTT 5.0, section 3.2.2.2)."""
_BAD_VERSION = b"\x20\x02\x00\x01"
"""CONNACK of MQTT 3.1.1: unacceptable protocol version (MQTT 3.1.1, section 3.2.2.3)."""


class EmbeddedBroker(Broker):  # type: ignore[misc] # amqtt has no types
    """MQTT 3.1.1 on one TCP port, for everybody who reaches it."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(
            {
                "listeners": {"default": {"type": "tcp", "bind": f"{host}:{port}"}},
                "plugins": {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}},
                "timeout_disconnect_delay": _GRACE_S,
            }
        )
        self._subscriptions = _SnapshotDict()
        self._newest: dict[str, Any] = {}
        """Each client's newest connection, as its StreamWriterAdapter, from its CONNECT to its end."""

    @property
    def broadcasts(self) -> bool:
        """Return whether messages are still passed on; a broker that does not is of no use."""
        return self._broadcast_task is not None and not self._broadcast_task.done()

    async def stream_connected(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, listener_name: str
    ) -> None:
        """Serve one connection from CONNECT to its end; what is not MQTT 3.1.1 is refused at once."""
        try:
            with contextlib.suppress(OSError, asyncio.IncompleteReadError):
                packet, level = await _read_connect(reader)
                if level == _LEVEL_311:
                    adapter = _PrefixedReader(packet, reader)
                    await self._client_connected(listener_name, adapter, StreamWriterAdapter(writer))
                elif level is not None:
                    writer.write(_BAD_VERSION_5 if level == _LEVEL_5 else _BAD_VERSION)
        finally:
            writer.close()
            asyncio.get_running_loop().call_later(_CLOSE_S, writer.transport.abort)

    async def _initialize_client_session(self, reader: Any, writer: Any, *rest: Any) -> tuple[Any, Any]:
        """Do as amqtt, and give up a client that is silent for longer than its keep-alive (MQTT-3.1.2-24).

        A client's earlier connection, also one that has just come, makes room for this one (MQTT-3.1.4-2): it is cut,
        which ends it as if the client had gone.
        """
        handler, session = await super()._initialize_client_session(reader, writer, *rest)
        handler.handle_read_timeout = reader.feed_eof
        earlier, self._newest[session.client_id] = self._newest.get(session.client_id), writer
        if earlier is not None:
            earlier._writer.transport.abort()
        return handler, session

    async def _client_message_loop(self, client_session: Any, handler: Any) -> None:
        """Serve one client until it is gone, and pass on all that was acknowledged."""
        delivered = client_session.delivered_message_queue
        served = [
            asyncio.create_task(_forever(self._handle_message_delivery, client_session, handler, delivered.get)),
            asyncio.create_task(
                _forever(self._handle_subscription, client_session, handler, handler.get_next_pending_subscription)
            ),
            asyncio.create_task(
                _forever(self._handle_unsubscription, client_session, handler, handler.get_next_pending_unsubscription)
            ),
        ]
        gone = asyncio.ensure_future(handler.wait_disconnect())
        reading = handler._reader_task  # who went before amqtt began to wait for that is noticed by its end alone
        await asyncio.wait([gone, reading, *served], return_when=asyncio.FIRST_COMPLETED)
        for task in served:
            task.cancel()
        results = await asyncio.gather(*served, return_exceptions=True)
        while not delivered.empty():
            await self._handle_message_delivery(client_session, handler, _done(delivered.get_nowait()))
        if not gone.done():  # without a farewell: its last will is published
            gone.cancel()
            gone = _done(None)
        await self._handle_disconnect(client_session, handler, gone)
        if self._newest.get(client_session.client_id) is handler.writer:
            del self._newest[client_session.client_id]
        for failed in results:
            if isinstance(failed, Exception):
                raise failed

    async def _publish_retained_messages_for_subscription(self, subscription: tuple[str, int], session: Any) -> None:
        """Send what is retained below one of the client's own subscriptions."""
        topic_filter, qos = subscription
        handler = self._get_handler(session)
        if handler is None or all(one != session for one, _ in self._subscriptions.get(topic_filter, ())):
            return
        kept = [one for topic, one in self._retained_messages.items() if self._matches(topic, topic_filter)]
        sending = (handler.mqtt_publish(one.topic, one.data, min(qos, one.qos or qos), retain=True) for one in kept)
        await asyncio.gather(*sending, return_exceptions=True)  # fails when the client goes: its loop sees that

    async def _cleanup_session(self, client_id: str) -> None:
        """Clear away a session whose client is gone, but not one that the client has taken up meanwhile."""
        session, _ = self._sessions.get(client_id, (None, None))
        if session is not None and session.transitions.state != "connected":
            await super()._cleanup_session(client_id)


class _SnapshotDict(UserDict[str, Any]):
    """A dictionary whose loops, over its items too, see the keys that there were when they began."""

    def __iter__(self) -> Iterator[str]:
        return iter(list(self.data))


class _PrefixedReader(StreamReaderAdapter):  # type: ignore[misc] # amqtt has no types
    """A stream of which the first bytes have been read already."""

    def __init__(self, first: bytes, reader: asyncio.StreamReader) -> None:
        super().__init__(reader)
        self._first = first

    async def read(self, n: int = -1) -> bytes:
        """Read exactly `n` bytes, or all until the end if it is -1."""
        if not self._first:
            return bytes(await super().read(n))
        end = len(self._first) if n < 0 else n
        taken, self._first = self._first[:end], self._first[end:]
        rest = n if n < 0 else n - len(taken)
        return taken + (await super().read(rest) if rest else b"")


async def _read_connect(reader: asyncio.StreamReader) -> tuple[bytes, int | None]:
    """Return the first packet and its protocol level: 4 for MQTT 3.1.1, 5 for MQTT 5, None when this is no MQTT.

    Raises OSError or IncompleteReadError when there is none that could be a CONNECT.
    """
    async with asyncio.timeout(_CONNECT_S):
        head = await reader.readexactly(2)
        while head[-1] & 0x80 and len(head) < 5:
            head += await reader.readexactly(1)
        length = sum((byte & 0x7F) << 7 * index for index, byte in enumerate(head[1:]))
        if head[0] != _CONNECT or length > _MAX_CONNECT_BYTES:
            raise ConnectionError("not a CONNECT")
        body = await reader.readexactly(length)
    if body.startswith(b"\x00\x04MQTT") and len(body) >= 7:
        return head + body, body[6]
    return head + body, 3 if body.startswith(b"\x00\x06MQIsdp") else None


async def _forever(
    handle: Callable[..., Awaitable[object]], session: Any, handler: Any, following: Callable[[], Awaitable[Any]]
) -> None:
    while await handle(session, handler, _done(await following())) is not False:
        pass


def _done(result: Any) -> "asyncio.Future[Any]":
    future = asyncio.get_running_loop().create_future()
    future.set_result(result)
    return future
