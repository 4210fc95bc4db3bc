"""Commands to the running service, over MQTT."""
