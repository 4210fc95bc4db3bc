"""Messages between service and clients over MQTT: topics, models, schemas. Pure."""
