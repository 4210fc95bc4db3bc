"""Faults at the real ends: the Qualisys server's sockets, the mock's command line and its orders."""

import asyncio
import signal
import socket
import time
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest
import pytest_asyncio
from pymavlink.dialects.v20 import development as mavlink

from mock_autopilot.config import MockConfig
from mock_autopilot.faults.mocap import MocapFaults
from mock_autopilot.faults.schedule import FaultSchedule
from mock_autopilot.faults.sentences import parse
from mock_autopilot.px4.vocabulary import Mode
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.packets import HEADER, PacketType, text_packet
from mock_autopilot.qtm.server import QualisysServer
from mock_autopilot.servos.config import FaultKind
from mock_autopilot.simulator import Simulator
from tests.mock_autopilot.process import Client, running, start
from tests.mock_autopilot.qtm.truths import flight

pytestmark = pytest.mark.realtime
FRAMES = 50
FRAME_BYTES = 8 + 16 + 8 + 8 + 52
"""Header, frame, component and its count, one body with residual."""


@pytest_asyncio.fixture
async def broken_server() -> AsyncIterator[QualisysServer]:
    """One whose packets are broken from 0.1 s to 0.4 s of the truth's time."""
    schedule = FaultSchedule([parse("mocap garbage (packets) on the ground after 0.1 s for 0.3 s")])
    config = QualisysConfig(port=0, delay_s=0.0)
    server = QualisysServer(config, 1, MocapFaults(schedule, np.random.default_rng(1), config.rate_hz))
    await server.start()
    yield server
    await server.stop()


def _publish(server: QualisysServer) -> None:
    assert isinstance(server.faults, MocapFaults)
    for truth in flight(FRAMES / 100.0):
        server.faults._schedule.step(truth.time_s, False, False, False)
        server.publish(truth)


async def test_packets_broken_over_tcp_keep_their_framing(broken_server: QualisysServer) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", broken_server.port)
    for command in ("version 1.25", "streamframes allframes 6dres"):
        writer.write(text_packet(PacketType.COMMAND, command))
    while not (broken_server._clients and next(iter(broken_server._clients))._session.stream):  # noqa: ASYNC110
        await asyncio.sleep(0.002)
    _publish(broken_server)
    data: list[bytes] = []
    async with asyncio.timeout(5.0):
        while len(data) < FRAMES:
            size, kind = HEADER.unpack(await reader.readexactly(HEADER.size))
            contents = await reader.readexactly(size - HEADER.size)
            if kind == PacketType.DATA:
                data.append(contents)
    whole = [index for index, contents in enumerate(data) if _number(contents) == index]
    assert set(whole) >= {*range(10), *range(40, 50)}
    assert len({len(contents) for contents in data[10:40]}) > 3, "some are cut off"
    assert len({len(data[index]) for index in whole if not 10 <= index < 40}) == 1
    writer.close()


def _number(contents: bytes) -> int:
    return int.from_bytes(contents[8:12], "little") if len(contents) == FRAME_BYTES - HEADER.size else -1


async def test_packets_broken_over_udp(broken_server: QualisysServer) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.setblocking(False)
        _, writer = await asyncio.open_connection("127.0.0.1", broken_server.port)
        command = f"streamframes allframes udp:127.0.0.1:{end.getsockname()[1]} 6dres"
        writer.write(text_packet(PacketType.COMMAND, command))
        while not (broken_server._clients and next(iter(broken_server._clients))._session.stream):  # noqa: ASYNC110
            await asyncio.sleep(0.002)
        _publish(broken_server)
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(5.0):
            packets = [await loop.sock_recv(end, 4096) for _ in range(FRAMES)]
        writer.close()
    assert [len(packet) for packet in packets[:10]] == [FRAME_BYTES] * 10
    assert all(HEADER.unpack_from(packet) == (len(packet), PacketType.DATA) for packet in packets)
    assert min(len(packet) for packet in packets[10:40]) < FRAME_BYTES


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("mocap stuk at 3 s", '--fault "mocap stuk at 3 s": mocap cannot be "stuk"; it can be off, stuck, '),
        ("servos off", "servos cannot fail on a vehicle without arms: set arms.enabled = true"),
    ],
)
def test_a_wrong_sentence_is_one_sentence_and_exit_code_2(sentence: str, said: str) -> None:
    process = start("--no-qualisys", "--fault", sentence)
    out, err = process.communicate(timeout=20.0)
    assert (process.returncode, out) == (2, "")
    assert err.startswith(f"mock autopilot: {said}")
    assert len(err.strip().splitlines()) == 1


def test_scripted_and_ordered_faults_happen_and_are_told_on_this_machines_clock() -> None:
    scripted = ("autopilot wrong (battery low) to 0.3 on the ground after 1.5 s", "mocap stuck landing for 2 s")
    with running(*(f"--fault={sentence}" for sentence in scripted)) as mock:
        client = Client(mock)
        told = mock.process.stdout.readline()
        at_s = float(told.split()[3])
        assert told.startswith("fault begins at ")
        assert told.endswith("s (monotonic): autopilot wrong (battery low) to 0.3 on the ground after 1.5 s\n")
        assert abs(time.monotonic() - at_s) < 5.0
        while client.wait_for("SYS_STATUS").battery_remaining > 31:  # PX4 rounds up
            pass
        before_ms = after_ms = client.wait_for("ATTITUDE").time_boot_ms
        mock.process.stdin.write("fault link off (from the autopilot) for 0.5 s\n")
        mock.process.stdin.flush()
        begun, ended = mock.process.stdout.readline(), mock.process.stdout.readline()
        assert "link off (from the autopilot) for 0.5 s" in begun
        assert ended.startswith("fault ends at ")
        assert float(ended.split()[3]) - float(begun.split()[3]) == pytest.approx(0.5, abs=0.003)
        while after_ms - before_ms < 100:
            before_ms, after_ms = after_ms, client.wait_for("ATTITUDE").time_boot_ms
        assert 495 <= after_ms - before_ms <= 530, "nothing was sent meanwhile"
        mock.process.stdin.write("fault mocap stuk\n")
        mock.process.stdin.flush()
        assert 'mocap cannot be "stuk"' in mock.process.stderr.readline()
        mock.process.stdin.write("carry 1 2\n")
        mock.process.stdin.flush()
        assert "it takes NORTH EAST DOWN" in mock.process.stderr.readline()
        mock.process.send_signal(signal.SIGTERM)
        assert mock.process.stdout.readline() == "fault never began: mocap stuck landing for 2 s\n"
        client.close()


async def test_the_ground_stations_link_stays_whole_and_servos_fail_on_their_bus(tmp_path: Path) -> None:
    config = MockConfig.from_dict(
        {
            "arms": {"enabled": True, "bus": {"link": str(tmp_path / "bus")}},
            "mavlink": {"local_port": 0, "remote_port": 1},
            "gcs": {"enabled": True, "local_port": 0, "remote_port": 2},
            "faults": [{"say": "servos off"}, {"say": "link off"}],
        }
    )
    async with Simulator(config, 1, with_qualisys=False) as simulator:
        while simulator.world.time_s < 0.1:  # noqa: ASYNC110 - simulated time follows the wall clock
            await asyncio.sleep(0.01)
        assert simulator.servo_bus is not None
        assert simulator.servo_bus.servos.active(FaultKind.SILENT_BUS)
        offboard = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        frame = bytes(offboard.pack(mavlink.MAVLink(None, srcSystem=245, srcComponent=190)))
        main, gcs = simulator.links
        main.handle(frame)
        assert simulator.world.vehicle.mode is Mode.HOLD
        gcs.handle(frame)
        until_s = simulator.world.time_s + 0.2  # PX4's commander takes commands on its own passes
        while simulator.world.vehicle.mode is Mode.HOLD and simulator.world.time_s < until_s:  # noqa: ASYNC110 - simulated time follows the wall clock
            await asyncio.sleep(0.01)
        assert simulator.world.vehicle.mode.custom_mode == Mode.OFFBOARD.custom_mode
