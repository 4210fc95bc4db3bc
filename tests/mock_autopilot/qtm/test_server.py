"""The mock server under the vendor's own SDK, over real sockets."""

import asyncio
import socket
from collections.abc import AsyncIterator
from typing import Any

import pytest
import pytest_asyncio
import qtm_rt
from qtm_rt.packet import QRTEvent
from qtm_rt.protocol import QRTCommandException

from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.server import QualisysServer, ServerStartError
from tests.mock_autopilot.qtm.truths import flight, truth_at

pytestmark = pytest.mark.realtime


@pytest_asyncio.fixture
async def server() -> AsyncIterator[QualisysServer]:
    server = QualisysServer(QualisysConfig(port=0, extra_bodies=("leader",), delay_s=0.0), seed=1)
    await server.start()
    yield server
    await server.stop()


async def until(condition: Any, for_s: float = 5.0) -> None:
    """Let the event loop run until `condition()` holds."""
    async with asyncio.timeout(for_s):
        while not condition():  # noqa: ASYNC110 - what is waited for is on the far side of a socket
            await asyncio.sleep(0.002)


async def connect(server: QualisysServer) -> Any:
    connection = await qtm_rt.connect("127.0.0.1", server.port)
    assert connection is not None
    return connection


async def stream(server: QualisysServer, connection: Any, how: str = "allframes", kind: str = "6dres") -> list[Any]:
    """Start a stream without waiting for its first frame; the frames come into the list."""
    got: list[Any] = []
    connection._protocol.set_on_packet(got.append)
    connection._protocol.send_command(f"streamframes {how} {kind}", callback=False)
    await connection.qtm_version()  # commands are answered in order: the stream has been asked for
    return got


async def test_the_sdk_connects_asks_and_streams(server: QualisysServer) -> None:
    connection = await connect(server)
    assert await connection.byte_order() == b"Byte order is little endian"
    assert (await connection.qtm_version()).startswith(b"QTM Version is")
    assert await connection.get_state() is QRTEvent.EventConnected
    assert b"<Name>leader</Name>" in await connection.get_parameters(["6d"])
    got = await stream(server, connection)
    for truth in flight(0.5):
        server.publish(truth)
    await until(lambda: len(got) == 50)
    assert [packet.framenumber for packet in got] == list(range(50))
    info, bodies = got[3].get_6d_residual()
    assert info.body_count == 2
    assert bodies[0][0].x == pytest.approx(30.0, abs=2.0), "1 m/s north for 30 ms, in millimetres"
    connection.disconnect()


async def test_the_current_frame_is_the_newest(server: QualisysServer) -> None:
    connection = await connect(server)
    for truth in flight(0.1):
        server.publish(truth)
    assert (await connection.get_current_frame(["6d"])).framenumber == 9
    connection.disconnect()


async def test_errors_reach_the_sdk_as_such(server: QualisysServer) -> None:
    connection = await connect(server)
    with pytest.raises(QRTCommandException, match="Component not supported: 3d"):
        await connection.get_current_frame(["3d"])
    assert await qtm_rt.connect("127.0.0.1", server.port, version="9.9") is None
    connection.disconnect()


async def test_every_client_gets_what_it_asked_for(server: QualisysServer) -> None:
    all_of_them, half = await connect(server), await connect(server)
    got_all, got_half = await stream(server, all_of_them), await stream(server, half, "frequencydivisor:2", "6d")
    for truth in flight(0.2):
        server.publish(truth)
    await until(lambda: len(got_all) == 20 and len(got_half) == 10)
    assert got_half[0].get_6d_residual() is None
    all_of_them.disconnect()
    half.disconnect()


@pytest.mark.parametrize("target", ["udp:{port}", "udp:127.0.0.1:{port}"])
async def test_frames_go_by_udp_when_asked(server: QualisysServer, target: str) -> None:
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.setblocking(False)
        connection = await connect(server)
        over_tcp = await stream(server, connection, f"allframes {target.format(port=receiver.getsockname()[1])}", "6d")
        server.publish(truth_at(0.0))
        async with asyncio.timeout(5.0):
            data = await asyncio.get_running_loop().sock_recv(receiver, 2000)
        assert qtm_rt.QRTPacket(data[8:]).framenumber == 0
        assert over_tcp == []
        connection.disconnect()


async def test_a_stopped_stream_stays_silent(server: QualisysServer) -> None:
    connection = await connect(server)
    got = await stream(server, connection)
    server.publish(truth_at(0.0))
    await until(lambda: len(got) == 1)
    await connection.stream_frames_stop()
    await connection.qtm_version()  # answered after the stop has been taken in
    connection._protocol.on_packet = got.append
    server.publish(truth_at(0.01))
    await connection.qtm_version()
    assert len(got) == 1
    connection.disconnect()


async def test_a_stopped_capture_is_an_event_and_can_start_again(server: QualisysServer) -> None:
    events: list[Any] = []
    connection = await qtm_rt.connect("127.0.0.1", server.port, on_event=events.append)
    got = await stream(server, connection)
    server.stop_capture()
    server.publish(truth_at(0.0))
    await until(lambda: events == [QRTEvent.EventCaptureStopped])
    server.start_capture()
    server.publish(truth_at(0.01))
    await until(lambda: len(got) == 1)
    assert events[-1] is QRTEvent.EventCaptureStarted
    connection.disconnect()


async def test_garbage_from_one_client_closes_that_one_only(server: QualisysServer) -> None:
    good = await connect(server)
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    writer.write(b"GET / HTTP/1.1\r\nHost: qtm\r\n\r\n")
    async with asyncio.timeout(5.0):
        assert (await reader.read()).endswith(b"QTM RT Interface connected\0")
    writer.close()
    assert await good.byte_order() == b"Byte order is little endian"
    assert server.client_count == 1
    good.disconnect()


async def test_a_client_that_vanishes_does_no_harm(server: QualisysServer) -> None:
    stays, goes = await connect(server), await connect(server)
    got = await stream(server, stays)
    await stream(server, goes)
    goes._protocol.transport.abort()
    for truth in flight(0.5):
        server.publish(truth)
    await until(lambda: len(got) == 50)
    await until(lambda: server.client_count == 1)
    stays.disconnect()


async def test_stopping_tells_the_clients_and_closes_them(server: QualisysServer) -> None:
    events: list[Any] = []
    ended: list[Any] = []
    await qtm_rt.connect("127.0.0.1", server.port, on_event=events.append, on_disconnect=ended.append)
    await server.stop()
    await until(lambda: len(ended) == 1)
    assert events == [QRTEvent.EventQTMShuttingDown]


async def test_a_taken_port_is_said_in_a_sentence(server: QualisysServer) -> None:
    second = QualisysServer(QualisysConfig(port=server.port), seed=1)
    with pytest.raises(ServerStartError, match=rf"cannot listen on 127\.0\.0\.1:{server.port} .*another port"):
        await second.start()


async def test_a_client_that_reads_nothing_is_cut_off(server: QualisysServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mock_autopilot.qtm.server.MAX_BACKLOG_BYTES", 1000)
    with socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)  # before connecting, when the window is agreed
        deaf.connect(("127.0.0.1", server.port))
        text = b"streamframes allframes 6d\0"
        deaf.sendall((8 + len(text)).to_bytes(4, "little") + b"\1\0\0\0" + text)
        await until(lambda: any(client._session.stream for client in server._clients))
        (client,) = server._clients
        assert client._transport is not None
        client._transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        for truth in flight(10.0):
            server.publish(truth)
        await until(lambda: server.client_count == 0)
