"""The embedded broker: amqtt in a process of its own, for operators on this computer alone."""

from companion.adapters.broker.process import open_broker

__all__ = ["open_broker"]
