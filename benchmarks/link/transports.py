"""Transports to compare: each has a sender on the ground and a receiver on the vehicle."""

import asyncio
import contextlib
import importlib
import importlib.util
import json
import logging
import shutil
import socket
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import aiomqtt

from benchmarks.link.message import EVENT_BYTES
from benchmarks.link.namespace import VEHICLE

PORT = 7447
TOPIC = "law/up"
ACK_LATER_S = 0.01
"""A message that is not acknowledged within the round trip and this is sent again."""
Send = Callable[[bytes], Awaitable[None]]
Take = Callable[[bytes], None]
_PUBLISH_S = 60.0
_NODELAY = (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, take: Callable[[bytes, Any], None]) -> None:
        self._take = take

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._take(data, addr)


@asynccontextmanager
async def datagram_sender() -> AsyncIterator[Send]:
    """One datagram a message."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(lambda *_: None), remote_addr=(VEHICLE, PORT))

    async def send(message: bytes) -> None:
        transport.sendto(message)

    yield send
    transport.close()


@asynccontextmanager
async def datagram_receiver(take: Take) -> AsyncIterator[None]:
    """Take each datagram."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(
        lambda: _Datagrams(lambda data, _: take(data)), local_addr=(VEHICLE, PORT)
    )
    yield
    transport.close()


class _Repeater:
    """Sends the newest message again until it is acknowledged."""

    def __init__(self) -> None:
        self.transport: asyncio.DatagramTransport | None = None
        self._newest, self._sent_s, self._round_trip_s = b"", 0.0, 0.02
        self._timer: asyncio.TimerHandle | None = None

    async def send(self, message: bytes) -> None:
        self._newest = message
        self._transmit()

    def acknowledge(self, data: bytes, _: Any) -> None:
        if self._timer is not None and data == self._newest[-8:]:
            self._round_trip_s += 0.125 * (time.monotonic() - self._sent_s - self._round_trip_s)
            self._timer.cancel()
            self._timer = None

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        assert self.transport is not None
        self.transport.close()

    def _transmit(self) -> None:
        assert self.transport is not None
        if self._timer is not None:
            self._timer.cancel()
        self._sent_s = time.monotonic()
        self.transport.sendto(self._newest)
        again_s = self._round_trip_s + ACK_LATER_S
        self._timer = asyncio.get_running_loop().call_later(again_s, self._transmit)


@asynccontextmanager
async def repeated_sender() -> AsyncIterator[Send]:
    """One datagram a message, the newest one again until it is acknowledged."""
    repeater = _Repeater()
    loop = asyncio.get_running_loop()
    repeater.transport, _ = await loop.create_datagram_endpoint(
        lambda: _Datagrams(repeater.acknowledge), remote_addr=(VEHICLE, PORT)
    )
    yield repeater.send
    repeater.close()


@asynccontextmanager
async def repeated_receiver(take: Take) -> AsyncIterator[None]:
    """Take each datagram and acknowledge it with its tag."""

    def answer(data: bytes, address: Any) -> None:
        transport.sendto(data[-8:], address)
        take(data)

    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(lambda: _Datagrams(answer), local_addr=(VEHICLE, PORT))
    yield
    transport.close()


@asynccontextmanager
async def tcp_sender() -> AsyncIterator[Send]:
    """Messages behind each other in a TCP connection, each after its length."""
    _, writer = await asyncio.open_connection(VEHICLE, PORT)  # asyncio sets TCP_NODELAY

    async def send(message: bytes) -> None:
        writer.write(bytes([len(message)]) + message)

    yield send
    writer.close()


@asynccontextmanager
async def tcp_receiver(take: Take) -> AsyncIterator[None]:
    """Take the messages of one connection."""

    async def read(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError, OSError):
            while True:
                (size,) = await reader.readexactly(1)
                take(await reader.readexactly(size))
        writer.close()

    server = await asyncio.start_server(read, VEHICLE, PORT)
    yield
    server.close()


@asynccontextmanager
async def mqtt_sender(version: int) -> AsyncIterator[Send]:
    """Publish with QoS 0 on the vehicle's broker."""
    async with aiomqtt.Client(
        VEHICLE, PORT, protocol=aiomqtt.ProtocolVersion(version), socket_options=[_NODELAY]
    ) as at:
        publishing: set[asyncio.Task[None]] = set()

        async def publish(message: bytes) -> None:
            with contextlib.suppress(aiomqtt.MqttError):  # the connection stalls or has ended: the message is lost
                await at.publish(TOPIC, message, qos=0, timeout=_PUBLISH_S)

        async def send(message: bytes) -> None:
            task = asyncio.create_task(publish(message), name="benchmarks.link.publish")  # others must not wait for it
            publishing.add(task)
            task.add_done_callback(publishing.discard)

        yield send


@asynccontextmanager
async def mqtt_receiver(take: Take, version: int) -> AsyncIterator[None]:
    """Run a broker, and subscribe to it without the link."""
    async with _broker(version), _subscribed(take, version):
        yield


@asynccontextmanager
async def _broker(version: int) -> AsyncIterator[None]:
    if version == _MQTT_5:
        words = ["mosquitto", "-c", "/dev/stdin"]
        settings = f"listener {PORT} 0.0.0.0\nallow_anonymous true\nset_tcp_nodelay true\nuser root\n"
    else:
        words = [sys.executable, "-m", "companion.adapters.broker", "0.0.0.0", str(PORT)]  # a namespace
        settings = ""
    pipe, nothing = asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(*words, stdin=pipe, stdout=nothing, stderr=nothing)
    assert process.stdin is not None
    process.stdin.write(settings.encode())
    if settings:
        process.stdin.close()
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


@asynccontextmanager
async def _subscribed(take: Take, version: int) -> AsyncIterator[None]:
    async with _connected(version) as client:
        await client.subscribe(TOPIC, qos=0)

        async def read() -> None:
            async for message in client.messages:
                assert isinstance(message.payload, bytes)
                take(message.payload)

        reading = asyncio.create_task(read(), name="benchmarks.link.read")
        try:
            yield
        finally:
            reading.cancel()


@asynccontextmanager
async def _connected(version: int) -> AsyncIterator[aiomqtt.Client]:
    """Connect to a broker that is about to listen."""
    until_s = time.monotonic() + 20.0
    while True:
        client = aiomqtt.Client("127.0.0.1", PORT, protocol=aiomqtt.ProtocolVersion(version))
        try:
            await client.__aenter__()
        except aiomqtt.MqttError:
            if time.monotonic() > until_s:
                raise
            await asyncio.sleep(0.2)
        else:
            break
    try:
        yield client
    finally:
        await client.__aexit__(None, None, None)


def _zenoh_session(module: Any, key: str, endpoint: str) -> Any:
    config = module.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5(f"{key}/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return module.open(config)


@asynccontextmanager
async def zenoh_sender(transport: str) -> AsyncIterator[Send]:
    """Put with Zenoh's settings for such messages: express, highest priority, dropped when congested."""
    zenoh = importlib.import_module("zenoh")
    with _zenoh_session(zenoh, "connect", f"{transport}/{VEHICLE}:{PORT}") as session:
        publisher = session.declare_publisher(
            TOPIC,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            reliability=zenoh.Reliability.BEST_EFFORT,
        )

        async def send(message: bytes) -> None:
            publisher.put(message)

        await asyncio.sleep(1.0)  # for the subscription to be known here
        yield send


@asynccontextmanager
async def zenoh_receiver(take: Take, transport: str) -> AsyncIterator[None]:
    """Subscribe; Zenoh calls from a thread of its own."""
    zenoh = importlib.import_module("zenoh")
    with _zenoh_session(zenoh, "listen", f"{transport}/{VEHICLE}:{PORT}") as session:
        session.declare_subscriber(TOPIC, lambda sample: take(sample.payload.to_bytes()))
        yield


_MQTT_311, _MQTT_5 = 4, 5
TRANSPORTS: dict[str, tuple[Callable[[], Any], Callable[[Take], Any]]] = {
    "datagram": (datagram_sender, datagram_receiver),
    "datagram, sent again": (repeated_sender, repeated_receiver),
    "TCP": (tcp_sender, tcp_receiver),
    "MQTT 3.1.1, embedded broker": (lambda: mqtt_sender(_MQTT_311), lambda take: mqtt_receiver(take, _MQTT_311)),
    "MQTT 5, mosquitto": (lambda: mqtt_sender(_MQTT_5), lambda take: mqtt_receiver(take, _MQTT_5)),
    "Zenoh, TCP": (lambda: zenoh_sender("tcp"), lambda take: zenoh_receiver(take, "tcp")),
    "Zenoh, UDP": (lambda: zenoh_sender("udp"), lambda take: zenoh_receiver(take, "udp")),
}
"""Sender and receiver of each."""


def missing(name: str) -> str:
    """Return why a transport cannot be measured here; empty when it can."""
    if name.startswith("Zenoh") and importlib.util.find_spec("zenoh") is None:
        return "eclipse-zenoh is not installed"
    if name.startswith("MQTT 5") and shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin") is None:
        return "mosquitto is not installed"
    return ""


def quiet() -> None:
    """Let no library write into the results."""
    logging.disable(logging.CRITICAL)
    assert EVENT_BYTES < 256, "the length before a message in a stream is one byte"
