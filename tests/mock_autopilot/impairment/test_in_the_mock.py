"""The mock's own links impaired: MAVLink in simulated time, QTM and port pairs over sockets; the settings."""

import asyncio
import socket
from pathlib import Path

import pytest

from mock_autopilot.__main__ import main
from mock_autopilot.config import MockConfig, MockConfigError
from mock_autopilot.faults.sentences import parse as parse_fault
from mock_autopilot.impairment import Directions, parse_directions
from mock_autopilot.qtm.config import QualisysConfig
from mock_autopilot.qtm.packets import PacketType, text_packet
from mock_autopilot.qtm.server import QualisysServer
from mock_autopilot.simulator import Simulator
from tests.mock_autopilot.bench import Bench
from tests.mock_autopilot.impairment.test_udp_relay import WAIT_S, ends, until
from tests.mock_autopilot.process import free_udp_port


def test_mavlink_loses_its_share_and_comes_late() -> None:
    clean, lossy = Bench(), Bench()
    lossy.link.impair(parse_directions("down loss 30% delay 20 ms"))
    for bench in (clean, lossy):
        bench.run(10.0)
    heard, sent = len(lossy.all("ATTITUDE")), len(clean.all("ATTITUDE"))
    assert heard / sent == pytest.approx(0.7, abs=0.05)
    ages_s = [one.time_s - one.message.time_boot_ms / 1e3 for one in lossy.all("ATTITUDE", 1.0)]
    assert min(ages_s) >= 0.019
    assert max(ages_s) <= 0.025, "the mock sends every 4 ms"


def test_a_command_over_a_cut_uplink_does_nothing() -> None:
    bench = Bench()
    bench.link.impair(parse_directions("up off"))
    bench.run(5.0)
    assert bench.arm() == []
    assert bench.all("HEARTBEAT", 1.0), "it is still heard"
    bench.link.impair(Directions())
    assert len(bench.arm()) == 1


async def test_qtm_answers_and_frames_come_late_over_tcp() -> None:
    server = QualisysServer(QualisysConfig(port=0, delay_s=0.0), 1, link=parse_directions("down delay 50 ms"))
    await server.start()
    try:
        loop = asyncio.get_running_loop()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        async with asyncio.timeout(WAIT_S):
            begin_s = loop.time()
            writer.write(text_packet(PacketType.COMMAND, "version 1.25"))
            await reader.readuntil(b"connected")
            assert loop.time() - begin_s > 0.04
            await reader.readuntil(b"Version set to 1.25")
            assert loop.time() - begin_s > 0.045
            server.impair(Directions())
            writer.write(text_packet(PacketType.COMMAND, "qtmversion"))
            await reader.readuntil(b"QTM Version")
        writer.close()
    finally:
        await server.stop()


async def test_qtm_loses_frames_over_udp() -> None:
    server = QualisysServer(QualisysConfig(port=0, delay_s=0.0), 1, link=parse_directions("down loss 30%"))
    await server.start()
    with ends(None) as (frames,):
        server._clients.clear()
        for number in range(200):
            server._send_datagram(b"%d" % number, ("127.0.0.1", frames.port))
        arrived = [(await frames.receive())[0] for _ in range(server._frames.counts.arrived)]
        assert 110 < len(arrived) < 170
    await server.stop()


async def test_a_port_pair_obeys_its_settings_its_orders_and_the_faults() -> None:
    with ends(None) as (server,):
        values = {
            "mavlink": {"local_port": 0, "remote_port": free_udp_port()},
            "impairment": {"relays": [{"listen": "0", "to": str(server.port), "link": "up delay 1 ms"}]},
        }
        async with Simulator(MockConfig.from_dict(values), 1, with_qualisys=False) as simulator:
            (pair,) = simulator.relayed
            (relay,) = simulator._relays
            with ends(pair.listen[1]) as (client,):
                await client.send(b"hello")
                assert (await server.receive())[0] == b"hello"
                simulator.world.inject(parse_fault("network off (up) for 0.5 s"))
                await client.send(b"lost")
                await until(lambda: relay.up_counts.lost == 1)
                simulator.impair("network", parse_directions("up loss 50%"))
                await until(lambda: relay.up.impairment.loss_share == 0.5)  # type: ignore[union-attr]
                simulator.impair("network", Directions())
                await client.send(b"heard")
                assert (await server.receive())[0] == b"heard"


def test_settings_and_what_is_said_about_wrong_ones(tmp_path: Path) -> None:
    path = tmp_path / "mock.toml"
    path.write_text(
        '[impairment]\nmavlink = "loss 10%"\n[[impairment.relays]]\nlisten = "9000"\nto = "vehicle:9001"\n',
        encoding="utf-8",
    )
    (relay,) = MockConfig.load(path).impairment.relays
    assert str(relay.pair()) == "udp 127.0.0.1:9000 -> vehicle:9001"
    for wrong, said in (
        ({"mavlink": "loss 10"}, r"impairment.mavlink = 'loss 10': \"loss 10\": loss is in %"),
        ({"qtm": "los 10%"}, "is no impairment"),
        ({"relays": [{"listen": "here", "to": "there:1"}]}, '"here" is no address'),
        ({"links": 1}, "unknown key"),
    ):
        with pytest.raises(MockConfigError, match=said):
            MockConfig.from_dict({"impairment": wrong})


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("bus loss 10%", 'write "mavlink SENTENCE", "qtm SENTENCE", "udp [HOST:]PORT to [HOST:]PORT SENTENCE"'),
        ("mavlink loss 10", "loss is in %"),
        ("udp 9000 to nowhere: loss 10%", '"nowhere:" is no address'),
    ],
)
def test_a_wrong_option_is_one_sentence(what: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--no-qualisys", "--impair", what]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f'mock autopilot: --impair "{what}": ')
    assert said in told
    assert told.count("\n") == 1


def test_a_taken_port_of_a_pair_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        options = ("--no-qualisys", "--listen", "0", "--port", str(free_udp_port()))
        assert main([*options, "--impair", f"udp {port} to 9 loss 10%"]) == 2
    assert f"cannot listen on UDP 127.0.0.1:{port}" in capsys.readouterr().err
