"""PX4 as an Autopilot, over MAVSDK's native 4.x API."""

from companion.adapters.px4.autopilot import Px4
from companion.adapters.px4.direct import flight_mode
from companion.adapters.px4.heard import LocalEstimate
from companion.adapters.px4.link import open_px4

__all__ = ["LocalEstimate", "Px4", "flight_mode", "open_px4"]
