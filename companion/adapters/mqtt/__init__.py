"""The service's end of the bus, and both ends of motion capture's, over MQTT.

Names are imported when they are asked for: an operator's command needs a connection and none of the rest.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from companion.adapters.mqtt.link import Answering, BusLink, OnCommand, open_bus
    from companion.adapters.mqtt.mocap import MqttMocap, open_mqtt_mocap
    from companion.adapters.mqtt.mocap_out import MocapOut, open_mocap_out

__all__ = [
    "Answering",
    "BusLink",
    "MocapOut",
    "MqttMocap",
    "OnCommand",
    "open_bus",
    "open_mocap_out",
    "open_mqtt_mocap",
]
_MODULES = {
    "Answering": "link",
    "BusLink": "link",
    "MocapOut": "mocap_out",
    "MqttMocap": "mocap",
    "OnCommand": "link",
    "open_bus": "link",
    "open_mocap_out": "mocap_out",
    "open_mqtt_mocap": "mocap",
}


def __getattr__(name: str) -> Any:
    """Return a name of `__all__`; AttributeError for any other."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
