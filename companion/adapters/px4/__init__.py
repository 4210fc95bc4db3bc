"""PX4 as an Autopilot, over MAVSDK's native 4.x API."""
