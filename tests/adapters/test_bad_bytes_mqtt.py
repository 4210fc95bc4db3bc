"""A broker that talks nonsense: the link outlives it, the loop goes on, and the next good broker is heard."""

import asyncio
import json
import time
from typing import ClassVar, cast

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.adapters.mqtt import connection, link
from companion.operator_orders import Order, OrderKind
from tests.adapters.bad_bytes import bad_stream, nothing_escapes
from tests.adapters.mqtt_rig import ORDER, Vehicle, linked, ticking, until
from tests.adapters.qtm_scripts import listening

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


def publish(payload: bytes, topic: bytes = ORDER.encode(), qos: int = 1) -> bytes:
    return head(0x30 | qos << 1, text(topic) + (b"\x00\x07" if qos else b"") + payload)


def order(kind: OrderKind, name: str) -> bytes:
    return json.dumps({"order": kind, "id": name, "sent_s": time.time()}).encode()


CONNACK, SUBACK, PUBACK = head(0x20, b"\x00\x00"), head(0x90, b"\x00\x01\x01"), head(0x40, b"\x00\x02")
PACKETS = (
    CONNACK,
    SUBACK,
    PUBACK,
    head(0x20, b"\x00\x05"),
    head(0x90, b"\x00\x01\x80"),
    head(0xD0, b""),
    head(0xB0, b"\x00\x01"),
    head(0x50, b"\x00\x02"),
    head(0x62, b"\x00\x07"),
    head(0x70, b"\x00\x02"),
    head(0xE0, b""),
    head(0x10, text(b"MQTT") + b"\x04\x02\x00\x05" + text(b"x")),
    publish(b"{}"),
    publish(b"\xff" * 200, b"a/b", 0),
    publish(b'{"order": "hold", "id": "old", "sent_s": 1.0}'),
    publish(b"x", b"\xff\xfe", 2),
    publish(b"", b"", 1),
)
"""Of every kind, as a broker may send them, and as it may not."""


class Broker(asyncio.Protocol):
    """Says the next of its bad sayings to whoever connects, each once; after that it is a good, small broker."""

    def __init__(self, sayings: list[bytes]) -> None:
        self._sayings = sayings
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
            packet, self._heard = self._heard[: 2 + self._heard[1]], self._heard[2 + self._heard[1] :]
            self._answer(packet)

    def _answer(self, packet: bytes) -> None:
        assert self._wire is not None
        match packet[0] & 0xF0:
            case 0x10:
                self._wire.write(CONNACK)
            case 0x80:
                self._wire.write(head(0x90, packet[2:4] + b"\x01") + publish(order(OrderKind.LAND, "good")))
            case 0x30:
                at = 4 + packet[3]
                self._wire.write(head(0x40, packet[at : at + 2]))


async def outlived(sayings: list[bytes]) -> None:
    """The property."""
    vehicle, bad = Vehicle(), list(sayings)
    async with nothing_escapes(), listening(lambda: Broker(bad)) as port:
        async with ticking() as longest_s, linked(port, vehicle) as operator:
            await until(lambda: vehicle.orders)
            await until(lambda: operator.age_s() == 0.0)
        await asyncio.sleep(0.0)
    assert vehicle.orders == [Order(OrderKind.LAND, "good")]
    assert longest_s[0] < BLOCKED_S


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits long for a broker that will not answer."""
    monkeypatch.setattr(connection, "ANSWER_S", 0.1)
    monkeypatch.setattr(link, "_BEAT_S", 0.05)
    monkeypatch.setattr(link, "_FIRST_PAUSE_S", 0.01)
    monkeypatch.setattr(link, "_LONGEST_PAUSE_S", 0.02)


SAYINGS = bad_stream(PACKETS) | st.sampled_from([CONNACK, CONNACK + SUBACK, CONNACK + SUBACK + PUBACK]).flatmap(
    lambda good: bad_stream(PACKETS).map(lambda bad: good + bad)
)
"""At once, or after a good beginning."""


@settings(max_examples=15, derandomize=True)
@given(st.lists(SAYINGS, min_size=1, max_size=3))
@example([CONNACK + SUBACK + SUBACK + 10 * CONNACK])  # what is written at once is watched no longer
async def test_a_broker_that_talks_nonsense_is_outlived(sayings: list[bytes]) -> None:
    await outlived(sayings)


class Stuffing(Broker):
    """Its second packet says that it has 256 MB, and the first 20 come at once."""

    def __init__(self, sayings: list[bytes], taken: list[bool]) -> None:
        super().__init__(sayings)
        self._taken = taken

    def resume_writing(self) -> None:
        self._taken.append(True)


async def test_a_huge_packet_is_not_collected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "ANSWER_S", 5.0)  # time enough to take it
    vehicle, taken = Vehicle(), list[bool]()
    sayings = [CONNACK + b"\x30\xff\xff\xff\x7f" + bytes(20_000_000)]
    async with nothing_escapes(), listening(lambda: Stuffing(sayings, taken)) as port, linked(port, vehicle):
        await until(lambda: vehicle.orders)
    assert not taken


class Hoarding(Broker):
    """A good broker, but its first connections bring messages at QoS 2 and never release them."""

    connections: ClassVar[list[int]] = []

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.connections.append(0)

    def _answer(self, packet: bytes) -> None:
        super()._answer(packet)
        assert self._wire is not None
        if len(self.connections) <= 2 and packet[0] & 0xF0 == 0x30:
            self._wire.write(publish(b"x" * 1000, qos=2))


async def test_a_broker_that_makes_us_keep_messages_for_it_is_left() -> None:
    async with nothing_escapes(), listening(lambda: Hoarding([])) as port, linked(port, Vehicle()) as operator:
        await until(lambda: len(Hoarding.connections) == 3)
        await until(lambda: operator.age_s() == 0.0)
        await asyncio.sleep(0.3)
        assert len(Hoarding.connections) == 3
