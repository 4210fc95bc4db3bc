"""Connection for a stream of which only the newest message counts: messages are passed on as they are read."""

import asyncio
from collections.abc import Callable

import aiomqtt
import paho.mqtt.client as paho
from aiomqtt.types import PahoSocket

from companion.adapters.mqtt.connection import Connection, Endpoint

OnMessage = Callable[[paho.MQTTMessage], None]

_AT_ONCE = 32
"""Messages that are read before anybody else has a turn: all that piled up, so that the flight loop sees the last one
only, and few enough that a flood does not stop it.
"""


class Feed(Connection):
    """A `Connection` without aiomqtt's queue, which makes a task for every message."""

    def __init__(self, endpoint: Endpoint, version: aiomqtt.ProtocolVersion, on_message: OnMessage) -> None:
        """`on_message` must not wait; what it raises ends the connection."""
        super().__init__(endpoint, version, waiting=1)
        self._hand_on = on_message
        self._read = 0

    async def follow(self, topic: str) -> None:
        """Subscribe at QoS 0, retained messages included; also a probe. MqttError when refused or not answered."""
        self.require_granted(await self.subscribe(topic, qos=0), topic)

    async def lost_within(self, timeout_s: float) -> None:
        """Return after that time; MqttError or OSError as soon as the connection is lost."""
        await asyncio.wait([self._disconnected], timeout=timeout_s)
        if self._disconnected.done():
            self._disconnected.result()
            raise aiomqtt.MqttError("the broker closed the connection")

    def _on_message(self, client: paho.Client, userdata: object, message: paho.MQTTMessage) -> None:  # noqa: ARG002
        self._read += 1
        self._hand_on(message)

    def _on_socket_open(self, client: paho.Client, userdata: object, sock: PahoSocket) -> None:
        """Register the socket for reading; one callback reads all pending messages, not one per loop iteration."""
        super()._on_socket_open(client, userdata, sock)

        def watch() -> None:
            if sock.fileno() >= 0:
                self._loop.add_reader(sock.fileno(), self._read_all)

        self._loop.call_soon_threadsafe(watch)

    def _read_all(self) -> None:
        try:
            for _ in range(_AT_ONCE):
                before = self._read
                self._client.loop_read()
                if self._read == before and not self._pending():
                    break
        except Exception as error:
            if not self._disconnected.done():
                self._disconnected.set_exception(error)

    def _pending(self) -> bool:
        """Return True when TLS has decrypted more than was read, which the socket does not show."""
        pending = getattr(self._client.socket(), "pending", None)
        return pending is not None and pending() > 0
