"""Flights whose frames come by way of bridge and broker: own processes, real sockets, wall-clock time."""

import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from companion.config.companion_config import load_config
from companion.supervisor.faults import Fault
from tests.broker import broker
from tests.flights.command import Running, start
from tests.flights.faults.judge import judged
from tests.flights.faults.real import Scene, _to_the_end, hover, mock
from tests.flights.faults.rows import REAL_S, RULES, End, Row, within
from tests.flights.faults.watch import Told
from tests.flights.simulated import BRISK
from tests.mavlink_relay import Relay
from tests.mosquitto import mosquitto, needs_mosquitto

pytestmark = pytest.mark.realtime


def configured(folder: Path, qtm_port: int, broker_port: int) -> Path:
    """One file for the bridge and for the vehicle, as a lab has it."""
    file = folder / "vehicle.toml"
    source = ['source = "mqtt"', f"port = {qtm_port}", "first_frame_timeout_s = 20.0"]
    file.write_text("\n".join(["[mocap]", *source, "[mocap.broker]", f"port = {broker_port}", ""]))
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
async def test_a_bridge_that_stops_is_px4s_landing(tmp_path: Path) -> None:
    with mosquitto(tmp_path, "allow_anonymous true") as port:
        await no_frames_any_more(tmp_path, port, lambda bridge: bridge.send(signal.SIGSTOP))


async def test_a_broker_that_stops_is_px4s_landing(tmp_path: Path) -> None:
    with broker() as server:
        await no_frames_any_more(tmp_path, server.port, lambda _: server.stop())


async def no_frames_any_more(folder: Path, port: int, break_it: Callable[[Running], None]) -> None:
    """React as when QTM itself is silent, and in the same time."""
    row = Row(Fault.MOCAP_SILENT, "no frames over MQTT", (), End.HANDED_OVER, within(RULES.silent_s) + REAL_S)
    told = Told()
    with Relay() as relay:
        async with mock(relay.ports) as autopilot:
            assert relay.ports.qualisys is not None
            config = configured(folder, relay.ports.qualisys, port)
            async with (
                bridging(config) as bridge,
                Scene(relay, autopilot, told).service(mocap=load_config(config).mocap, flight=BRISK) as operator,
            ):
                await hover(operator)
                autopilot.tell("begin")
                break_it(bridge)
                planned_s = await _to_the_end(operator)
            flown = await autopilot.flown()
    result = judged(row, flown, told, planned_s)
    assert not result.problems, result
    assert result.reaction_s is not None
    assert result.reaction_s > RULES.coast_s, "the fault was none"
