"""Limit on MQTT 5 properties: paho's parsing time grows with the square of their number."""

from paho.mqtt.properties import VariableByteIntegers

MAX_PROPERTIES_BYTES = 512
"""A response topic and a number of the sender's have less. 60 kB of properties hold up the flight loop for 0.8 s."""


def with_few_properties(publish: bytes, qos: int) -> bytes:
    """Return a PUBLISH's body (MQTT 5, 3.3.2), without its properties, and so its reply address, if they are many."""
    at = 2 + int.from_bytes(publish[:2], "big") + (2 if qos else 0)
    try:
        size, digits = VariableByteIntegers.decode(publish[at : at + 4])  # type: ignore[no-untyped-call]
    except Exception:  # paho's to find, and to end the connection for
        return publish
    if size <= MAX_PROPERTIES_BYTES:
        return publish
    return publish[:at] + b"\x00" + publish[at + digits + size :]
