"""Mock QTM, bridge, broker and source in one process, over real sockets, with time in the tests' hands."""

import asyncio
import itertools
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from unittest.mock import patch

from companion.adapters.mqtt import mocap_out
from companion.adapters.mqtt.mocap import MqttMocap, open_mqtt_mocap
from companion.adapters.system.clock import MonotonicClock
from companion.config.mocap_config import MocapBrokerConfig, MocapConfig
from companion.core.interfaces import MocapSource
from companion.service.mocap_bridge import Bridge
from mock_autopilot.qtm.server import QualisysServer
from tests.adapters.qualisys.rig import ManualClock, QualisysRig, capturing, serving, settings_for

_VEHICLES = itertools.count()


def on_broker(port: int) -> MocapBrokerConfig:
    """Return a configuration with a vehicle name that is unique on this broker."""
    return MocapBrokerConfig(port=port, vehicle=f"v{next(_VEHICLES)}")


@asynccontextmanager
async def bridging(config: MocapConfig, broker: MocapBrokerConfig) -> AsyncIterator[Bridge]:
    """Run the bridge, with a short search for another bridge."""
    bridge = Bridge(config, broker, MonotonicClock())
    with patch.object(mocap_out, "_LISTEN_S", 0.02):
        running = asyncio.create_task(bridge.run(), name="bridge")
        try:
            yield bridge
        finally:
            running.cancel()
            with suppress(asyncio.CancelledError):
                await running


class MqttMocapRig(QualisysRig):
    """`mocap_contract.Rig`: what the mock QTM captures comes by way of bridge and broker."""

    source: MqttMocap  # type: ignore[assignment]

    def __init__(
        self, server: QualisysServer, source: MqttMocap, clock: ManualClock, frames: int, broker: MocapBrokerConfig
    ) -> None:
        super().__init__(server, source, clock, frames)  # type: ignore[arg-type]
        self.broker = broker


@asynccontextmanager
async def mqtt_mocap_rig(port: int) -> AsyncIterator[MqttMocapRig]:
    """Yield the rig once all frames of the start were received."""
    clock, broker = ManualClock(), on_broker(port)
    async with serving(extra_bodies=("leader",)) as server:
        config = settings_for(server, source="mqtt", transport="udp")
        async with bridging(config, broker):
            async with capturing(server) as newest:
                opening = open_mqtt_mocap(config, broker, clock)
                source = await opening.__aenter__()
            try:
                await drained(source)
                yield MqttMocapRig(server, source, clock, newest[0], broker)
            finally:
                await opening.__aexit__(None, None, None)


async def drained(source: MocapSource) -> None:
    """Wait until no frame is in transit."""
    while await source.wait_frame(0.05):
        pass
