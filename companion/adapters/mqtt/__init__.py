"""The service's end of the bus, over MQTT."""

from companion.adapters.mqtt.link import Answering, BusLink, OnCommand, open_bus

__all__ = ["Answering", "BusLink", "OnCommand", "open_bus"]
