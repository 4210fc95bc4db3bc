"""The service's end of the bus, and both ends of motion capture's, over MQTT."""
