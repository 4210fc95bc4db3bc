"""Another rigid body takes our body's place in QTM: the vehicle does not arm, and in the air PX4 lands.

Real qtm-rt, MAVSDK and sockets, in wall-clock time, by every way on which frames come.
"""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from companion.config.companion_config import load_config
from companion.config.mocap_config import MocapConfig
from companion.core.interfaces import CompanionError
from companion.preflight import service_facts
from companion.service.flight_actions import FlightActions
from companion.supervisor.faults import FailsafeAction, Fault
from companion.supervisor.flight_state import Phase
from tests.broker import broker
from tests.flights.faults.real import Scene, hover, mock
from tests.flights.faults.rows import REAL_S, RULES, within
from tests.flights.faults.watch import Told
from tests.flights.simulated import BRISK
from tests.flights.test_mocap_over_mqtt import bridging, configured
from tests.mavlink_relay import Relay

pytestmark = pytest.mark.realtime

REPLACED = "mocap wrong (body replaced)"
GROUND_S = 2.5
_PATIENCE_S = 10.0


@asynccontextmanager
async def mocap(way: str, folder: Path, qtm_port: int) -> AsyncIterator[MocapConfig]:
    """Yield the [mocap] table that the vehicle is to have, while what it needs is running."""
    if way != "bridge":
        yield MocapConfig.model_validate({"port": qtm_port, "transport": way})
        return
    with broker() as server:
        config = configured(folder, qtm_port, server.port)
        async with bridging(config):
            yield load_config(config).mocap


async def until(service: FlightActions, phase: Phase) -> None:
    async with asyncio.timeout(_PATIENCE_S):
        while service.phase is not phase:  # noqa: ASYNC110 - the loop tells nobody
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("way", ["tcp", "udp", "bridge"])
async def test_another_body_is_refused_on_the_ground_and_in_the_air_px4_lands(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service_facts, "_SETTLE_S", 0.5)  # vision is not fused while there is none
    told = Told()
    with Relay() as relay:
        async with mock(relay.ports) as autopilot:
            assert relay.ports.qualisys is not None
            async with (
                mocap(way, tmp_path, relay.ports.qualisys) as source,
                Scene(relay, autopilot, told).service(mocap=source, flight=BRISK) as operator,
            ):
                service = operator.service
                await service.ready()
                autopilot.tell(f"{REPLACED} for {GROUND_S:g} s")
                until_s = time.monotonic() + GROUND_S
                await asyncio.sleep(0.1)
                with pytest.raises(CompanionError, match="does not know the body 'dauam'; it has: box"):
                    await operator.do("arm")
                await asyncio.sleep(until_s - time.monotonic() + 0.2)
                await hover(operator)
                replaced_s = time.monotonic()
                autopilot.tell(REPLACED)
                await until(service, Phase.HANDED_OVER)
                assert time.monotonic() - replaced_s < within(RULES.silent_s) + REAL_S + 0.1
                flight = service.loop.flight
                assert (flight.cause, flight.level) == (Fault.MOCAP_SILENT, FailsafeAction.AUTOPILOT_LAND)
                if way == "tcp":  # one blind landing of PX4's is enough
                    await until(service, Phase.DISARMED)
                await asyncio.sleep(0.2)
            flown = await autopilot.flown()
    assert "LAND" in [mode for _, mode in flown.modes]
    assert not flown.disarmed_in_the_air
    assert flown.beyond_m < 0.0, "inside the fence"
