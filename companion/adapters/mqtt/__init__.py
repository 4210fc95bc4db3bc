"""The operator's orders over MQTT."""

from companion.adapters.mqtt.link import MqttOperator, open_operator

__all__ = ["MqttOperator", "open_operator"]
