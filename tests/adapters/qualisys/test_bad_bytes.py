"""A motion-capture server that talks nonsense, at the real qtm-rt and the adapter, over TCP and UDP."""

import asyncio
import socket
import struct
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.qualisys.packets import MAX_PACKET_BYTES
from companion.adapters.qualisys.source import QualisysSource
from companion.adapters.system.clock import MonotonicClock
from companion.config.mocap_config import MocapConfig
from companion.core.interfaces import MocapError
from tests.adapters.bad_bytes import bad_stream, nothing_escapes, one_bad
from tests.adapters.mqtt.rig import ticking
from tests.adapters.qualisys.qtm_scripts import (
    COMMAND,
    DATA,
    ERROR,
    EVENT,
    LEVEL_BODY,
    NO_MORE_DATA,
    ONE_BODY,
    VERSION_SET,
    WELCOME,
    XML,
    Scripted,
    frame,
    listening,
    packet,
)

pytestmark = pytest.mark.realtime

CLOCK = MonotonicClock()
PATIENCE_S = 5.0
BLOCKED_S = 0.5
FAR_US = 2_000_000
"""Between the stamps of good frames: whatever came between, one of two must be newer, or a new measurement."""
NAN, INF = float("nan"), float("inf")
PACKETS = (
    frame(3, 30_000, [LEVEL_BODY]),
    frame(4, 40_000, [LEVEL_BODY, LEVEL_BODY]),
    frame(5, -1, []),
    frame(2**32 - 1, 2**63 - 1, [[NAN] * 13]),
    frame(0, -(2**63), [[INF, -INF, 3e38] + [1e-40] * 10]),
    packet(DATA, struct.pack("<qII", 50_000, 5, 0)),
    packet(DATA, struct.pack("<qIIII", 50_000, 5, 1, 0, 11)),
    packet(DATA, struct.pack("<qIIIIihh", 50_000, 5, 1, 16, 11, -1, 0, 0)),
    packet(DATA, struct.pack("<qIIIIihh", 50_000, 5, 1, 16, 11, 2**31 - 1, 0, 0)),
    packet(DATA, struct.pack("<qII", 50_000, 5, 2**32 - 1)),
    packet(DATA, struct.pack("<qIIII", 50_000, 5, 1, 12, 5) + bytes(4)),
    packet(ERROR, b"Parse error\0"),
    packet(COMMAND, b"Ok\0"),
    packet(XML, b"<a/>\0"),
    packet(NO_MORE_DATA, b""),
    packet(EVENT, b"\x01"),
    packet(EVENT, b"\xff"),
    packet(EVENT, b""),
    packet(99, b"?"),
    ONE_BODY,
    WELCOME,
    VERSION_SET,
)


class Server(Scripted):
    """A conversation of good or bad answers; after it the test says more."""

    def __init__(self, servers: "list[Server]", answers: Mapping[str, bytes], welcome: bytes = WELCOME) -> None:
        super().__init__(welcome, answers)
        servers.append(self)
        self._udp: tuple[socket.socket, int] | None = None

    def data_received(self, data: bytes) -> None:
        if b"udp:" in data:
            port = int(data.split(b"udp:")[1].split(b" ")[0])
            self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), port
            for said in GOOD_BEGIN:
                self.say(said)
        super().data_received(data)
        if b"stop" in data and self._transport is not None:
            self._transport.close()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        if self._udp is not None:
            self._udp[0].close()
            self._udp = None

    def say(self, said: bytes) -> None:
        """By datagram if it was asked for so."""
        assert self._transport is not None
        if self._udp is not None:
            self._udp[0].sendto(said, ("127.0.0.1", self._udp[1]))
        elif not self._transport.is_closing():
            self._transport.write(said)


GOOD_BEGIN = (frame(1, 10_000, [LEVEL_BODY]), frame(2, 20_000, [LEVEL_BODY]))
ANSWERS = {"version": VERSION_SET, "getparameters": ONE_BODY, "streamframes": b"".join(GOOD_BEGIN)}
UDP_ANSWERS = ANSWERS | {"streamframes": packet(COMMAND, b"Ok\0")}


@asynccontextmanager
async def opened(port: int, transport: Literal["tcp", "udp"] = "tcp") -> AsyncIterator[QualisysSource]:
    config = MocapConfig(port=port, transport=transport, connect_timeout_s=0.3, first_frame_timeout_s=0.3)
    async with open_qualisys(config, CLOCK) as source:
        yield source


async def good_again(source: QualisysSource, server: "Server") -> None:
    """Go on sending good frames until one of them is believed; fails when none is.

    Frames of another number of bodies make the list of bodies be read before any frame is believed.
    """
    number, loop = 100, asyncio.get_running_loop()
    end_s = loop.time() + PATIENCE_S
    while loop.time() < end_s:
        number += 1
        server.say(frame(number, 60_000_000 + number * FAR_US, [LEVEL_BODY]))
        await source.wait_frame(0.02)
        newest = source.latest()
        if newest is not None and 100 < newest.frame <= number:
            return
    raise AssertionError(f"no good frame is believed: {source.trouble or source.counts}")


async def begun_anew(servers: list[Server]) -> None:
    """Until there is a second connection."""
    async with asyncio.timeout(PATIENCE_S):
        while len(servers) == 1:  # noqa: ASYNC110 - the far side of a socket
            await asyncio.sleep(0.01)


def whole(stream: bytes) -> bool:
    """Return True when the packets that follow can still be separated: QTM's have sizes, no marks."""
    at = 0
    while at <= len(stream) - 8:
        size = int.from_bytes(stream[at : at + 4], "little")
        if size < 8:
            return False
        at += size
    return at == len(stream)


async def outlived_tcp(bad: bytes, breaks_off: bool = False) -> None:
    """The property: a refusal; a new connection; or the good frames that follow."""
    servers = list[Server]()
    async with nothing_escapes(), listening(lambda: Server(servers, ANSWERS)) as port, ticking() as longest_s:
        try:
            async with opened(port) as source:
                servers[0].say(bad)
                if breaks_off:
                    await begun_anew(servers)
                elif whole(bad):
                    await good_again(source, servers[-1])
                else:
                    await source.wait_frame(0.02)
        except MocapError:
            pass
        await asyncio.sleep(0.01)
    assert longest_s[0] < BLOCKED_S


async def outlived_udp(bad: list[bytes]) -> None:
    """The property: the good frames that follow."""
    servers = list[Server]()
    async with nothing_escapes(), listening(lambda: Server(servers, UDP_ANSWERS)) as port, ticking() as longest_s:
        async with opened(port, "udp") as source:
            for said in bad:
                servers[0].say(said)
            await good_again(source, servers[-1])
        await asyncio.sleep(0.01)
    assert longest_s[0] < BLOCKED_S


async def opened_or_refused(answers: Mapping[str, bytes], welcome: bytes) -> None:
    """The property: a sentence, or frames, and both soon."""
    async with nothing_escapes(), listening(lambda: Server([], answers, welcome)) as port, asyncio.timeout(PATIENCE_S):
        with suppress(MocapError):
            async with opened(port) as source:
                assert source.latest() is not None
        await asyncio.sleep(0.01)


BAD = bad_stream(PACKETS)
CONVERSATION = st.fixed_dictionaries({word: st.just(said) | BAD for word, said in ANSWERS.items()})


@settings(max_examples=25)
@given(BAD)
async def test_a_stream_of_nonsense_ends_with_a_sentence_or_is_outlived(bad: bytes) -> None:
    await outlived_tcp(bad)


@settings(max_examples=25)
@given(st.lists(one_bad(PACKETS), min_size=1, max_size=8))
async def test_datagrams_of_nonsense_are_outlived(bad: list[bytes]) -> None:
    await outlived_udp(bad)


@settings(max_examples=15)
@given(CONVERSATION, st.just(WELCOME) | BAD)
async def test_a_server_that_answers_nonsense_is_refused_soon_or_used(
    answers: dict[str, bytes], welcome: bytes
) -> None:
    await opened_or_refused(answers, welcome)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-7", "klingon", "idna", "cp037", "hex"])
async def test_settings_in_a_strange_encoding_are_refused(encoding: str) -> None:
    settings_ = f"<?xml version='1.0' encoding='{encoding}'?>".encode() + ONE_BODY[8:]
    await opened_or_refused({**ANSWERS, "getparameters": packet(XML, settings_)}, WELCOME)


@pytest.mark.parametrize(
    "said", [packet(NO_MORE_DATA, b""), packet(EVENT, b"\x01"), GOOD_BEGIN[0]], ids=["no more data", "event", "frame"]
)
async def test_a_flood_does_not_hold_up_the_loop(said: bytes) -> None:
    await outlived_tcp(said * (4_000_000 // len(said)), breaks_off=said is not GOOD_BEGIN[0])


async def test_a_huge_packet_that_never_ends_is_kept_no_longer_than_its_size() -> None:
    servers, size = list[Server](), MAX_PACKET_BYTES[XML]
    async with nothing_escapes(), listening(lambda: Server(servers, ANSWERS)) as port, opened(port) as source:
        servers[0].say(struct.pack("<II", size, XML) + bytes(size - 8))
        await good_again(source, servers[0])
        servers[0].say(struct.pack("<II", size + 1, XML))
        await begun_anew(servers)
