"""The service's end of the bus, and both ends of motion capture's, over MQTT."""

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
