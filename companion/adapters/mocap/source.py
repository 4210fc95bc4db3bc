"""Motion capture by the way that the configuration names."""

from contextlib import AbstractAsyncContextManager

from companion.adapters.mqtt.mocap import open_mqtt_mocap
from companion.adapters.qualisys.connect import open_qualisys
from companion.config.companion_config import CompanionConfig
from companion.core.interfaces import Clock, MocapSource


def open_mocap(config: CompanionConfig, clock: Clock) -> AbstractAsyncContextManager[MocapSource]:
    """Open the configured source, which delivers frames once entered; MocapError when it does not."""
    if config.mocap.source == "mqtt":
        return open_mqtt_mocap(config.mocap, config.mocap_broker(), clock)
    return open_qualisys(config.mocap, clock, config.separation.others_than(config.mocap.body))
