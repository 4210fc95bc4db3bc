"""The mock's MAVLink end: messages, streams, UDP link."""
