"""The real mosquitto: see tests/mosquitto.py."""

from tests.mosquitto import mosquitto, needs_mosquitto

__all__ = ["mosquitto", "needs_mosquitto"]
