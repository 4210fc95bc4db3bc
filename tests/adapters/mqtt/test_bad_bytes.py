"""A broker that talks nonsense: the link outlives it, the loop goes on, and the next good broker is heard."""

import asyncio
from typing import ClassVar, cast

import aiomqtt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.adapters.mqtt import connection, link, reconnector
from tests.adapters.bad_bytes import bad_stream, nothing_escapes
from tests.adapters.mqtt.rig import TOPICS, Vehicle, command, linked, ticking, until
from tests.adapters.qualisys.qtm_scripts import listening

pytestmark = pytest.mark.realtime

BLOCKED_S = 0.5


def head(kind: int, body: bytes) -> bytes:
    """MQTT 3.1.1, 2.2: kind and flags, remaining length."""
    length, size = len(body), b""
    while True:
        length, digit = divmod(length, 128)
        size += bytes([digit | (0x80 if length else 0)])
        if not length:
            return bytes([kind]) + size + body


def text(said: bytes) -> bytes:
    return len(said).to_bytes(2, "big") + said


def publish(payload: bytes, topic: bytes = TOPICS.command.encode(), qos: int = 1, properties: bytes = b"") -> bytes:
    """`properties` with their length, for MQTT 5."""
    return head(0x30 | qos << 1, text(topic) + (b"\x00\x07" if qos else b"") + properties + payload)


def properties(said: bytes) -> bytes:
    """MQTT 5, 2.2.2; of less than 128 bytes."""
    return bytes([len(said)]) + said


CONNACK, SUBACK, PUBACK = head(0x20, b"\x00\x00"), head(0x90, b"\x00\x01\x01"), head(0x40, b"\x00\x02")
CONNACK_5, SUBACK_5 = head(0x20, b"\x00\x00\x00"), head(0x90, b"\x00\x01\x00\x01")
NO_MQTT_5 = head(0x20, b"\x00\x01")
COMMON = (
    PUBACK,
    head(0xD0, b""),
    head(0xB0, b"\x00\x01"),
    head(0x50, b"\x00\x02"),
    head(0x62, b"\x00\x07"),
    head(0x70, b"\x00\x02"),
    head(0xE0, b""),
)
PACKETS = (
    *COMMON,
    CONNACK,
    SUBACK,
    NO_MQTT_5,
    head(0x20, b"\x00\x05"),
    head(0x90, b"\x00\x01\x80"),
    head(0x10, text(b"MQTT") + b"\x04\x02\x00\x05" + text(b"x")),
    publish(b"{}"),
    publish(b"\xff" * 200, b"a/b", 0),
    publish(command("hold", "old", sent_s=1.0)),
    publish(b"x", b"\xff\xfe", 2),
    publish(b"", b"", 1),
)
"""Packets of every kind, permitted and not."""
REASON, USER = b"\x1f" + text(b"why"), b"\x26" + text(b"a") + text(b"b")
ASKS = b"\x08" + text(TOPICS.reply("me").encode()) + b"\x09" + text(b"7")
PACKETS_5 = (
    *COMMON,
    CONNACK_5,
    SUBACK_5,
    head(
        0x20, b"\x00\x00" + properties(b"\x13\x00\x01\x21\x00\x01\x24\x00\x25\x00\x27\x00\x00\x00\x10" + REASON + USER)
    ),
    head(0x20, b"\x00\x87" + properties(REASON)),
    head(0x20, b"\x00\x84\x00"),
    head(0x90, b"\x00\x01" + properties(REASON + USER) + b"\x87"),
    head(0x40, b"\x00\x02\x97" + properties(REASON)),
    head(0xE0, b"\x8b" + properties(REASON)),
    head(0xF0, b"\x18" + properties(b"\x15" + text(b"SCRAM"))),
    publish(b"{}", properties=properties(ASKS)),
    publish(command("hold", "old", sent_s=1.0), properties=properties(ASKS + USER * 4)),
    publish(b"x", b"", 1, properties(b"\x23\x00\x01")),
    publish(b"x", properties=b"\xff\xff\x03" + USER * 20),
    publish(b"x", b"\xff\xfe", 2, properties(b"")),
)
"""The same, of MQTT 5."""


class Broker(asyncio.Protocol):
    """Says the next of its bad sayings to whoever connects, each once; after that it is a good, small broker."""

    def __init__(self, sayings: list[bytes], version: int = 4) -> None:
        self._sayings, self._version = sayings, version
        self._wire: asyncio.Transport | None = None
        self._heard = b""
        self._good = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._wire = cast(asyncio.Transport, transport)
        self._good = not self._sayings
        if self._sayings:
            self._wire.write(self._sayings.pop(0))

    def data_received(self, data: bytes) -> None:
        self._heard += data
        while self._good and len(self._heard) >= 2 and len(self._heard) >= 2 + self._heard[1]:
            length = 2 if self._heard[1] & 0x80 else 1
            size = 1 + length + (self._heard[1] & 0x7F) + (self._heard[2] << 7 if length == 2 else 0)
            if len(self._heard) < size:
                return
            packet, self._heard = self._heard[:1] + self._heard[1 + length : size], self._heard[size:]
            self._answer(packet[0] & 0xF0, packet[1:])

    def _answer(self, kind: int, body: bytes) -> None:
        assert self._wire is not None
        five = self._version == 5
        match kind:
            case 0x10 if body[6] > self._version:
                self._wire.write(NO_MQTT_5)
            case 0x10:
                self._wire.write(CONNACK_5 if body[6] == 5 else CONNACK)
                self._version = body[6]
            case 0x80:
                granted = b"\x00\x01" if five else b"\x01"
                good = publish(command("land", "good"), properties=properties(b"") if five else b"")
                self._wire.write(head(0x90, body[:2] + granted) + good)
            case 0x30:
                at = 2 + int.from_bytes(body[:2], "big")
                self._wire.write(head(0x40, body[at : at + 2]))


async def outlived(sayings: list[bytes], version: int) -> None:
    """Check the property: after these packets the link still connects and answers."""
    vehicle, bad = Vehicle(), list(sayings)
    async with nothing_escapes(), listening(lambda: Broker(bad, version)) as port:
        async with ticking() as longest_s, linked(port, vehicle) as operator:
            await until(lambda: vehicle.commands)
            await until(lambda: operator.age_s() == 0.0)
        await asyncio.sleep(0.0)
    assert vehicle.told == [("land", "good")]
    assert longest_s[0] < BLOCKED_S


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits long for a broker that will not answer."""
    monkeypatch.setattr(connection, "ANSWER_S", 0.1)
    monkeypatch.setattr(link, "_BEAT_S", 0.05)
    monkeypatch.setattr(reconnector, "_FIRST_PAUSE_S", 0.01)
    monkeypatch.setattr(reconnector, "_LONGEST_PAUSE_S", 0.02)


def sayings(packets: tuple[bytes, ...], connack: bytes, suback: bytes) -> st.SearchStrategy[list[bytes]]:
    """At once, or after a good beginning."""
    begun = st.sampled_from([b"", connack, connack + suback, connack + suback + PUBACK])
    return st.lists(st.tuples(begun, bad_stream(packets)).map(b"".join), min_size=1, max_size=3)


@settings(max_examples=15)
@given(sayings(PACKETS, CONNACK, SUBACK))
@example([NO_MQTT_5, CONNACK + SUBACK + SUBACK + 10 * CONNACK])  # what is written at once is watched no longer
async def test_a_broker_that_talks_nonsense_is_outlived(said: list[bytes]) -> None:
    await outlived([NO_MQTT_5, *said], 4)


@settings(max_examples=15)
@given(sayings(PACKETS_5, CONNACK_5, SUBACK_5))
@example([CONNACK_5 + SUBACK_5 + SUBACK_5 + 10 * CONNACK_5])
async def test_a_broker_that_talks_nonsense_of_mqtt_5_is_outlived(said: list[bytes]) -> None:
    await outlived(said, 5)


_SIZE = len(USER * 8000)
MANY = bytes([_SIZE & 0x7F | 0x80, _SIZE >> 7 & 0x7F | 0x80, _SIZE >> 14]) + USER * 8000
"""Properties, with their length."""


@pytest.mark.parametrize("kind", [0x20, 0x40, 0x90, 0xE0])
async def test_more_properties_than_can_be_read_in_time_end_the_connection(kind: int) -> None:
    bodies = {0x20: b"\x00\x00", 0x40: b"\x00\x02\x00", 0x90: b"\x00\x01", 0xE0: b"\x8b"}
    await outlived([(b"" if kind == 0x20 else CONNACK_5 + SUBACK_5) + head(kind, bodies[kind] + MANY)], 5)


class Lavish(Broker):
    """A good broker that passes on a message with very many properties."""

    def _answer(self, kind: int, body: bytes) -> None:
        super()._answer(kind, body)
        assert self._wire is not None
        if kind == 0x80:
            self._wire.write(publish(command("hold", "many"), properties=MANY))


async def test_a_message_with_more_properties_than_can_be_read_in_time_is_read_without_them() -> None:
    """Whoever may command may have sent them: that is no reason to leave the broker."""
    vehicle = Vehicle()
    async with listening(lambda: Lavish([], 5)) as port, ticking() as longest_s, linked(port, vehicle):
        await until(lambda: vehicle.told == [("land", "good"), ("hold", "many")])
    assert longest_s[0] < BLOCKED_S


class Stuffing(Broker):
    """Its second packet says that it has 256 MB, and the first 20 come at once."""

    def __init__(self, sayings: list[bytes], taken: list[bool]) -> None:
        super().__init__(sayings, 5)
        self._taken = taken

    def resume_writing(self) -> None:
        self._taken.append(True)


async def test_a_huge_packet_is_not_collected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "ANSWER_S", 5.0)  # time enough to take it
    vehicle, taken = Vehicle(), list[bool]()
    sayings = [CONNACK_5 + b"\x30\xff\xff\xff\x7f" + bytes(20_000_000)]
    async with nothing_escapes(), listening(lambda: Stuffing(sayings, taken)) as port, linked(port, vehicle):
        await until(lambda: vehicle.commands)
    assert not taken


class Hoarding(Broker):
    """A good broker, but its first connections bring messages at QoS 2 and never release them."""

    connections: ClassVar[list[int]] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.connections.append(0)

    def _answer(self, kind: int, body: bytes) -> None:
        super()._answer(kind, body)
        assert self._wire is not None
        if len(self.connections) <= 2 and kind == 0x30:
            self._wire.write(publish(b"x" * 1000, qos=2, properties=properties(b"")))


async def test_a_broker_that_makes_us_keep_messages_for_it_is_left() -> None:
    async with nothing_escapes(), listening(lambda: Hoarding([], 5)) as port, linked(port, Vehicle()) as operator:
        await until(lambda: len(Hoarding.connections) == 3)
        await until(lambda: operator.age_s() == 0.0)
        await asyncio.sleep(0.3)
        assert len(Hoarding.connections) == 3


async def test_an_answer_that_comes_while_the_link_is_closed_does_not_keep_it_open() -> None:
    """A task that forgot that it is cancelled would wait for ever, and with it the next connection."""
    will = aiomqtt.Will(TOPICS.status)
    endpoint = connection.Endpoint(
        host="127.0.0.1", port=1, identifier="x", user=None, password=None, tls=None, will=will
    )
    broker = connection.Connection(endpoint, connection.V5, 1)
    answer: asyncio.Future[None] = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(broker._wait_for(answer, None))
    await asyncio.sleep(0)
    answer.set_result(None)
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting
