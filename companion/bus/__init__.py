"""What service and operators say to each other over MQTT: topics, messages and what counts as a command; pure."""
