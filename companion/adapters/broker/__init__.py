"""The embedded broker: amqtt in a process of its own, for operators on this computer alone."""
