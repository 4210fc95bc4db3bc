"""PX4 as an Autopilot, over MAVSDK's native 4.x API."""

from companion.adapters.px4.autopilot import Px4
from companion.adapters.px4.link import open_px4
from companion.adapters.px4.mavlink import flight_mode
from companion.adapters.px4.telemetry import LocalEstimate

__all__ = ["LocalEstimate", "Px4", "flight_mode", "open_px4"]
