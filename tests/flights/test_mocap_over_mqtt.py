"""Flights whose frames come by way of bridge and broker: own processes, real sockets, wall-clock time."""

import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from companion.cli.demo.mock_process import free_ports
from companion.config.companion_config import load_config
from companion.supervisor.faults import Fault
from tests.broker import BrokerProcess, broker
from tests.flights.command import ROOT, Running, read_json, run, start
from tests.flights.faults.judge import judged
from tests.flights.faults.real import Scene, _to_the_end, hover, mock
from tests.flights.faults.rows import REAL_S, RULES, End, Row, within
from tests.flights.faults.watch import Told
from tests.flights.simulated import BRISK
from tests.mavlink_relay import Relay
from tests.mosquitto import mosquitto, needs_mosquitto
from tests.warm import mock_process

pytestmark = pytest.mark.realtime


def configured(folder: Path, qtm_port: int, broker_port: int, *lines: str) -> Path:
    """One file for the bridge and for the vehicle, as a lab has it."""
    file = folder / "vehicle.toml"
    source = ['source = "mqtt"', f"port = {qtm_port}", "first_frame_timeout_s = 20.0"]
    file.write_text("\n".join(["[mocap]", *source, "[mocap.broker]", f"port = {broker_port}", *lines, ""]))
    return file


@asynccontextmanager
async def bridging(config: Path) -> AsyncIterator[Running]:
    """`companion mocap-bridge` at work; ended with Ctrl-C, which is a good end."""
    bridge = await start("mocap-bridge", "--config", config)
    try:
        yield bridge
    finally:
        bridge.send(signal.SIGCONT)
        bridge.interrupt()
        ran = await bridge.ended()
    assert ran.code == 0, ran.said
    assert "Traceback" not in ran.said


@needs_mosquitto
async def test_a_whole_flight_over_mosquitto_lands_and_says_so(tmp_path: Path) -> None:
    ports, summary = free_ports(), tmp_path / "summary.json"
    with mosquitto(tmp_path, "allow_anonymous true") as port:
        assert ports.qualisys is not None
        low = ("takeoff_height_m = 0.8", "climb_speed_mps = 1.0", "descent_speed_mps = 0.4", "settle_s = 0.2")
        flies = (
            "[flight]",
            *low,
            "[px4]",
            f'url = "udpin://127.0.0.1:{ports.client}"',
            "[preflight]",
            "realtime = false",
        )
        easy = ("by_hand_within_h = 0.0", "mocap_hz = 50.0", "delay_apart_s = 0.05")
        config = configured(tmp_path, ports.qualisys, port, *flies, *easy)
        async with mock_process(ROOT / "config" / "mock.toml", 1, ports), bridging(config):
            curve = ("--laps", "1", "--period", "5", "--size", "0.5", "--arms", "off")
            options = ("--no-mocks", "--config", config, "--out", tmp_path, "--summary", summary)
            ran = await run("demo", *curve, *options)
    assert ran.code == 0, ran.said
    data = read_json(summary)
    assert data["landed"] is True
    assert data["disarmed"] is True


def stop_bridge(bridge: Running, _: BrokerProcess) -> None:
    bridge.send(signal.SIGSTOP)


def stop_broker(_: Running, server: BrokerProcess) -> None:
    server.stop()


@pytest.mark.parametrize("break_it", [stop_bridge, stop_broker])
async def test_no_frames_any_more_is_px4s_landing_whoever_is_the_reason(
    tmp_path: Path, break_it: Callable[[Running, BrokerProcess], None]
) -> None:
    """React as when QTM itself is silent, and in the same time."""
    row = Row(Fault.MOCAP_SILENT, break_it.__name__, (), End.HANDED_OVER, within(RULES.silent_s) + REAL_S)
    told = Told()
    with Relay() as relay, broker() as server:
        async with mock(relay.ports) as autopilot:
            assert relay.ports.qualisys is not None
            config = configured(tmp_path, relay.ports.qualisys, server.port)
            async with (
                bridging(config) as bridge,
                Scene(relay, autopilot, told).service(mocap=load_config(config).mocap, flight=BRISK) as operator,
            ):
                await hover(operator)
                autopilot.tell("begin")
                break_it(bridge, server)
                planned_s = await _to_the_end(operator)
            flown = await autopilot.flown()
    result = judged(row, flown, told, planned_s)
    assert not result.problems, result
    assert result.reaction_s is not None
    assert result.reaction_s > RULES.coast_s, "the fault was none"
