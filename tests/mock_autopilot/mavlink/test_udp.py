"""The MAVLink end over real sockets."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from tests.mock_autopilot.process import Client, Mock, free_udp_port, running

pytestmark = pytest.mark.realtime


@pytest.fixture
def mock() -> Iterator[Mock]:
    with running() as mock:
        yield mock


def _arm(value: float = 1.0) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, 400, 0, value, 0, 0, 0, 0, 0, 0)


def _set_mode(main: float) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, main, 0, 0, 0, 0, 0)


def _target(thrust: float) -> Any:
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, thrust)


def test_it_streams_to_a_silent_client_one_frame_a_datagram(mock: Mock) -> None:
    client = Client(mock)
    seen, last = set(), -1
    for _ in range(400):
        (message,) = client.receive()
        sequence, system, component = message.get_msgbuf()[4:7]  # of messages that pymavlink does not know, too
        assert (system, component) == (1, 1)
        if last >= 0:
            assert sequence == (last + 1) % 256
        last = sequence
        seen.add(message.get_type())
    client.close()
    assert {"ATTITUDE", "LOCAL_POSITION_NED", "HIGHRES_IMU", "HEARTBEAT"} <= seen


def test_answers_go_to_the_client_even_when_a_stranger_asks(mock: Mock) -> None:
    client, stranger = Client(mock), Client(mock, port=free_udp_port(), system=77)
    stranger.send(_arm())
    ack = client.wait_for("COMMAND_ACK")
    assert (ack.command, ack.target_system) == (400, 77)
    client.close()
    stranger.close()


def test_it_survives_a_client_that_vanishes_and_serves_its_successor(mock: Mock) -> None:
    first = Client(mock)
    first.wait_for("HEARTBEAT")
    first.close()
    stranger = Client(mock, port=free_udp_port())
    for _ in range(20):  # what it sends to nobody is refused by the kernel, and it does not mind
        stranger.send(mavlink.MAVLink_ping_message(0, 1, 0, 0))
        time.sleep(0.02)
    second = Client(mock)
    second.send(mavlink.MAVLink_ping_message(123, 9, 0, 0))
    while second.wait_for("PING").time_usec != 123:
        pass
    assert mock.process.returncode is None
    second.close()
    stranger.close()


def test_garbage_does_not_hurt(mock: Mock) -> None:
    client = Client(mock)
    for size in (0, 1, 10, 280, 2000):
        client.socket.sendto(os.urandom(size), ("127.0.0.1", mock.own_port))
    good = bytes(_arm().pack(client.codec))
    client.socket.sendto(good[:-1] + bytes([good[-1] ^ 0xFF]), ("127.0.0.1", mock.own_port))
    client.send(mavlink.MAVLink_command_long_message(1, 1, 31010, 0, 1, 0, 0, 0, 0, 0, 0))
    ack = client.wait_for("COMMAND_ACK")
    assert (ack.command, ack.result) == (31010, 3), "only the good command is answered"
    client.close()


def test_all_parameters_arrive(mock: Mock) -> None:
    client = Client(mock)
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    names = {client.wait_for("PARAM_VALUE").param_id for _ in range(879)}
    assert len(names) == 879
    client.close()


def test_setpoints_that_came_during_a_stall_count_when_they_came(mock: Mock) -> None:
    """The process sleeps for 1.6 s while setpoints keep coming: PX4's 1.0 s of silence never happened."""
    client = Client(mock)
    stop = threading.Event()

    def stream() -> None:
        while not stop.wait(0.02):
            client.send(_target(0.0))

    sender = threading.Thread(target=stream)
    sender.start()
    try:
        client.wait_for("HEARTBEAT")
        client.send(_set_mode(6.0))
        _until_heartbeat(client, custom_mode=0x60000, system_status=3)
        client.send(_arm())
        _until_heartbeat(client, base_mode=145)
        os.kill(mock.process.pid, signal.SIGSTOP)
        time.sleep(1.6)
        os.kill(mock.process.pid, signal.SIGCONT)
        states = [client.wait_for("HEARTBEAT") for _ in range(3)]
        assert {state.base_mode for state in states} == {145}, "still armed in OFFBOARD"
    finally:
        stop.set()
        sender.join()
        client.close()


def _until_heartbeat(client: Client, **wanted: int) -> None:
    for _ in range(12):
        beat = client.wait_for("HEARTBEAT")
        if all(getattr(beat, name) == value for name, value in wanted.items()):
            return
    raise AssertionError(f"no HEARTBEAT with {wanted}")


def test_ground_stations_on_two_links_see_each_other(tmp_path: Path) -> None:
    gcs_client, gcs_own = free_udp_port(), free_udp_port()
    config = tmp_path / "mock.toml"
    config.write_text(f"[gcs]\nenabled = true\nlocal_port = {gcs_own}\nremote_port = {gcs_client}\n", encoding="utf-8")
    with running("--config", str(config)) as mock:
        onboard = Client(mock)
        ground = Client(Mock(mock.process, gcs_client, gcs_own), system=255)
        ground.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        while onboard.wait_for("HEARTBEAT").get_srcSystem() != 255:
            pass
        ground.send(mavlink.MAVLink_command_long_message(1, 1, 31010, 0, 1, 0, 0, 0, 0, 0, 0))
        ack = ground.wait_for("COMMAND_ACK")
        assert (ack.command, ack.target_system) == (31010, 255)
        ground.close()
        onboard.close()
