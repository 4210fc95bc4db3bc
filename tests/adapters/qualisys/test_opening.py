"""Everything that can be wrong between an address and a stream, and the sentence that says so."""

import asyncio
import logging
import socket
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from companion.adapters.mocap.newest_frame import MocapCounts
from companion.adapters.qualisys import stream_watch
from companion.adapters.qualisys.connect import open_qualisys
from companion.adapters.qualisys.source import QualisysSource
from companion.adapters.system.clock import MonotonicClock
from companion.config.mocap_config import MocapConfig
from companion.core.interfaces import MocapError
from tests.adapters.qualisys.qtm_scripts import (
    COMMAND,
    DATA,
    ERROR,
    EVENT,
    GOOD,
    LEVEL_BODY,
    NO_BODIES,
    NO_MORE_DATA,
    WELCOME,
    XML,
    Scripted,
    Silent,
    frame,
    listening,
    packet,
    scripted,
)
from tests.adapters.qualisys.rig import capturing, serving, settings_for

pytestmark = pytest.mark.realtime

SOON_S = 0.1
CLOCK = MonotonicClock()


async def refusal(port: int, **settings: Any) -> str:
    """Return the error with which opening fails."""
    config = MocapConfig(**({"port": port, "connect_timeout_s": 5.0, "first_frame_timeout_s": 5.0} | settings))
    with pytest.raises(MocapError) as caught:
        async with open_qualisys(config, CLOCK):
            pass
    return str(caught.value)


async def test_nothing_listens() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    text = await refusal(port)
    assert f"no QTM at 127.0.0.1:{port}" in text
    assert "start QTM" in text


async def test_a_name_that_is_no_address() -> None:
    assert "QTM at no-such-host.invalid:1" in await refusal(1, host="no-such-host.invalid")


async def test_a_server_that_accepts_and_says_nothing() -> None:
    async with listening(Silent) as port:
        assert "accepts connections but does not answer" in await refusal(port, connect_timeout_s=SOON_S)


async def test_a_server_that_answers_the_version_only() -> None:
    async with scripted({"version": GOOD["version"], "getparameters": b""}) as port:
        assert "does not answer" in await refusal(port, connect_timeout_s=SOON_S)


async def test_a_server_that_hangs_up() -> None:
    async with scripted({}) as port:
        assert (await refusal(port)).endswith("closed the connection")


async def test_a_qtm_that_refuses_every_version_is_told_which_would_do() -> None:
    async with scripted({"version": packet(ERROR, b"Version NOT supported\0")}) as port:
        text = await refusal(port)
    assert "knows no version of the RT protocol from 1.25 down to 1.18" in text
    assert "or port 22222, which has version 1.0 only (22223 is the one to use)" in text


@pytest.mark.parametrize(
    ("minor", "lost"),
    [(24, ""), (23, "which does not tell whether a body is disabled"), (18, "is disabled, or relative to another one")],
)
async def test_an_older_qtm_is_spoken_to_in_its_own_version(
    minor: int, lost: str, caplog: pytest.LogCaptureFixture
) -> None:
    async with (
        serving(newest_minor=minor, extra_bodies=("wand",)) as server,
        capturing(server),
        open_qualisys(settings_for(server), CLOCK) as source,
    ):
        assert await source.wait_frame(5.0)
    assert (f"speaks RT protocol 1.{minor}, " in caplog.text) == bool(lost)
    assert lost in caplog.text


async def test_a_body_that_qtm_does_not_know_is_answered_with_those_it_has() -> None:
    async with serving(body="drone", extra_bodies=("leader", "wand")) as server:
        text = await refusal(server.port, body="dauam")
    assert "does not know the body 'dauam'; it has: drone, leader, wand" in text


async def test_no_bodies_at_all() -> None:
    async with scripted({**GOOD, "getparameters": NO_BODIES}) as port:
        assert "has no rigid bodies: define 'dauam'" in await refusal(port)


async def test_settings_that_are_no_xml() -> None:
    async with scripted({**GOOD, "getparameters": packet(XML, b"<QTM_Parameters\0")}) as port:
        assert "sent settings that are no XML" in await refusal(port)


@pytest.mark.parametrize("transport", ["tcp", "udp"])
async def test_connected_but_not_measuring(transport: str) -> None:
    async with serving() as server:
        server.stop_capture()
        text = await refusal(server.port, transport=transport, first_frame_timeout_s=SOON_S)
    assert "is connected but sends no frames: start the capture (Capture > New, real-time on)" in text
    assert ("firewall" in text) == (transport == "udp")


@pytest.mark.parametrize("transport", ["tcp", "udp"])
async def test_a_stream_that_is_refused_is_told_at_once(transport: str) -> None:
    async with scripted({**GOOD, "streamframes": packet(ERROR, b"No 6D license\0")}) as port:
        assert "refuses to stream (No 6D license)" in await refusal(port, transport=transport)


async def test_a_udp_port_that_is_taken() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        async with serving() as server:
            text = await refusal(server.port, transport="udp", udp_port=port)
    assert f"cannot receive frames on UDP 127.0.0.1:{port}" in text


WITHOUT_6DOF = frame(1, 0, []), packet(DATA, struct.pack("<qII", 0, 1, 0))


@pytest.mark.parametrize("said", WITHOUT_6DOF, ids=["no bodies", "no component"])
async def test_frames_without_bodies_are_answered_with_the_setting_to_change(said: bytes) -> None:
    async with scripted({**GOOD, "streamframes": said}) as port:
        text = await refusal(port, first_frame_timeout_s=SOON_S)
    assert text == (
        f"QTM at 127.0.0.1:{port} sends frames without rigid bodies: switch on Project options > Processing > "
        "Real-time actions > Calculate 6DOF"
    )


async def test_frames_of_other_bodies_than_the_settings_have_are_refused() -> None:
    async with scripted({**GOOD, "streamframes": frame(1, 0, [LEVEL_BODY, LEVEL_BODY])}) as port:
        text = await refusal(port, first_frame_timeout_s=SOON_S)
    assert "sends frames of 2 rigid bodies, and its settings have 1: dauam" in text


async def test_frames_from_another_address_are_named() -> None:
    """A workstation with two network cards, a container, a forwarded port."""
    async with serving() as server, capturing(server):
        assert server._udp is not None
        server._udp.close()
        loop = asyncio.get_running_loop()
        server._udp, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=("127.0.0.2", 0))
        text = await refusal(server.port, transport="udp", first_frame_timeout_s=SOON_S)
    assert text.startswith("frames come from 127.0.0.2, not from mocap.host 127.0.0.1: ")


async def test_the_frame_that_proves_the_stream_is_still_to_be_waited_for() -> None:
    async with scripted(GOOD) as port, open_qualisys(MocapConfig(port=port), CLOCK) as source:
        latest = source.latest()
        assert latest is not None
        assert await source.wait_frame(0.0)


async def test_our_body_is_found_by_its_place_among_the_others() -> None:
    async with (
        serving(body="leader", extra_bodies=("wand", "dauam")) as server,
        capturing(server),
        open_qualisys(settings_for(server), CLOCK) as source,
    ):
        latest = source.latest()
        assert latest is not None
        assert latest.position_w_m.tolist() == [1.5, 2.0, 0.0], "where the mock stands its second extra body"


async def test_leaving_closes_the_connection() -> None:
    async with serving() as server, capturing(server):
        async with open_qualisys(settings_for(server), CLOCK) as source:
            assert server.client_count == 1
        async with asyncio.timeout(5.0):
            while server.client_count:  # noqa: ASYNC110 - the far side of a socket
                await asyncio.sleep(0.002)
        with pytest.raises(MocapError):
            await source.wait_frame(0.0)


async def test_what_qtm_says_of_its_capture_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    says = packet(EVENT, b"\4") + packet(NO_MORE_DATA, b"") + packet(EVENT, b"\3")
    with caplog.at_level(logging.INFO, "companion"):
        async with (
            scripted({**GOOD, "streamframes": says + GOOD["streamframes"]}) as port,
            open_qualisys(MocapConfig(port=port), CLOCK),
        ):
            pass
    assert [(r.levelname, r.getMessage()) for r in caplog.records if r.name.startswith("companion")] == [
        ("WARNING", "QTM says: CaptureStopped"),
        ("INFO", "QTM says: CaptureStarted"),
    ]


@pytest.mark.parametrize(
    "garbage",
    [
        b"\0" * 64,
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
        packet(COMMAND, b"Version set to 1.25\0") + packet(17, b"?"),
        packet(EVENT, b""),
        packet(EVENT, b"\xff"),
    ],
    ids=["zeros", "another protocol", "unknown packet", "empty event", "unknown event"],
)
async def test_a_server_of_another_kind_is_recognised(garbage: bytes) -> None:
    async with scripted(GOOD, welcome=garbage) as port:
        text = await refusal(port, connect_timeout_s=1.0)
    assert text.startswith(f"QTM at 127.0.0.1:{port} sent ")
    assert text.endswith("is it really QTM's little-endian port?")


@asynccontextmanager
async def talked_to() -> AsyncIterator[tuple[QualisysSource, list[Scripted], int]]:
    """A source that has had its first frame, the conversations with it so far, and its port."""
    conversations = list[Scripted]()

    def converse() -> Scripted:
        first = frame(1, 10_000 + 1_000_000 * len(conversations), [LEVEL_BODY])
        conversations.append(Scripted(WELCOME, {**GOOD, "streamframes": first}))
        return conversations[-1]

    async with listening(converse) as port, open_qualisys(MocapConfig(port=port), CLOCK) as source:
        assert await source.wait_frame(0.0)
        yield source, conversations, port


def say(conversation: Scripted, said: bytes) -> None:
    assert conversation._transport is not None
    conversation._transport.write(said)


async def test_a_stream_that_loses_its_packets_begin_is_asked_for_anew(caplog: pytest.LogCaptureFixture) -> None:
    async with talked_to() as (source, conversations, port):
        for _ in range(3):
            say(conversations[-1], bytes(8))
            assert await source.wait_frame(5.0)
        assert source.counts == MocapCounts(received=4)
    lost = f"QTM at 127.0.0.1:{port} sent a packet of 0 bytes: is it really QTM's little-endian port?"
    assert caplog.text.count(lost) == caplog.text.count("is back\n") == 3


async def test_packets_nobody_can_read_are_dropped_and_told_once(caplog: pytest.LogCaptureFixture) -> None:
    cut, lying = packet(DATA, frame(2, 20_000, [LEVEL_BODY])[8:-4]), packet(DATA, frame(2, 20_000, [LEVEL_BODY])[8:-9])
    whole = [frame(k, k * 10_000, [LEVEL_BODY]) for k in range(2, 15)]
    async with talked_to() as (source, conversations, port):
        say(conversations[0], b"".join([cut, lying, packet(99, b"?"), packet(EVENT, b""), *whole]))
        assert await source.wait_frame(5.0)
        assert source.counts == MocapCounts(received=4, lost=10, malformed=4, doubted=10)
        assert len(conversations) == 1
    told = [record.getMessage() for record in caplog.records if "dropped" in record.getMessage()]
    assert told == [f"QTM at 127.0.0.1:{port} sent a frame that ends too early: such packets are dropped, and counted"]


async def test_a_stream_that_falls_silent_is_asked_for_anew(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A server that hangs, a QTM computer without power: the connection stays open, and nothing comes."""
    monkeypatch.setattr(stream_watch, "SILENT_S", SOON_S)
    async with talked_to() as (source, conversations, port):
        for _ in range(2):  # each conversation says one frame
            assert await source.wait_frame(5.0)
        assert len(conversations) >= 3
    assert caplog.text.count(f"no frames until QTM is back: QTM at 127.0.0.1:{port} has sent no frames for") >= 2


async def test_a_length_that_cannot_be_is_no_reason_to_wait_for_the_rest() -> None:
    async with talked_to() as (source, conversations, _):
        say(conversations[0], struct.pack("<II", 15_000_000, DATA))
        assert await source.wait_frame(5.0)
        assert len(conversations) == 2


async def test_a_qtm_that_measures_nothing_for_long_is_told_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream_watch, "SILENT_S", SOON_S)
    async with serving() as server:
        async with capturing(server):
            opening = open_qualisys(settings_for(server), CLOCK)
            source = await opening.__aenter__()
        server.stop_capture()
        while await source.wait_frame(5 * SOON_S):
            pass
        server.start_capture()
        async with capturing(server):
            assert await source.wait_frame(5.0)
        await opening.__aexit__(None, None, None)
    assert caplog.text.count("no frames until QTM is back") == caplog.text.count("is back\n") == 1


async def test_leaving_while_qtm_is_looked_for_leaves_nothing_behind() -> None:
    async with serving() as server, capturing(server):
        async with open_qualisys(settings_for(server), CLOCK) as source:
            await server.stop()
            while await source.wait_frame(0.25):
                pass
        with pytest.raises(MocapError, match="is not listened to any more"):
            await source.wait_frame(0.0)
    names = {task.get_name() for task in asyncio.all_tasks()}
    assert "companion.qualisys" not in names
